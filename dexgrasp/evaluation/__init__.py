"""Agents scored under one protocol, with honest statistics."""
