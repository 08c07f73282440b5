"""The robot: descriptions of makers, robot files, cells, MuJoCo specifications.

Takes URDF, MJCF and YAML; gives a `Robot`, and a `Cell` with its cameras and its table's height, from the cell's file
or as a cloud shows it (`table`). A new hand begins in `make`. It solves no kinematics.
"""
