"""Imitation of demonstrations: chunks of set-points from what a robot sees, by a network small enough for numpy."""
