"""The scene: table, lights, robot and objects in one MuJoCo model.

Takes a cell and objects; gives a model, whose table top is z = 0, and its sensors. It steps nothing.
"""
