"""Lift-v0: pick the object up and hold it."""
