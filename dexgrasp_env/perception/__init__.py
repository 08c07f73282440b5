"""Depth cameras and the way from depth to a segmented cloud and its hull."""
