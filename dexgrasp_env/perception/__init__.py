"""Perception in four stages: cloud, support, instances, selection.

Takes depth images or points; gives a `Scene` with the object's points, or a reason. It sees no true pose.
"""
