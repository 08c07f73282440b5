"""Objects: the catalogue, builders of shapes, users' meshes, convex parts, rest poses.

Takes names, set files or meshes; gives solids with mass and inertia. It knows no robot.
"""
