"""Grasp physics: friction cones, wrenches, closure, margins, forces."""
