"""The robot: descriptions of makers, robot files, cells, MuJoCo specifications.

Takes URDF, MJCF and YAML; gives a `Robot` value and its specification. It solves no kinematics.
"""
