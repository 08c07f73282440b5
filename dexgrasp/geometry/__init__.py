"""Geometry: signed distances to solids, samples of surfaces, and the target made of what a scene shows.

Takes meshes and segmented clouds; gives distances and a `GraspTarget`. It knows no robot.
"""
