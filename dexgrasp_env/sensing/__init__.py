"""Simulated depth cameras: their sensor model, and ray and GL backends."""
