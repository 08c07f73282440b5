"""The scene: table, lights, robot and objects in one MuJoCo model.

Takes a robot and objects; gives a model and its sensors. It steps nothing.
"""
