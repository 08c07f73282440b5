"""Agents: planners and policies that act in the environments."""
