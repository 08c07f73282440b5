"""Dexterous grasping on a table: Gymnasium environments for a Panda arm with an Allegro hand."""

__version__ = "0.1.0"
