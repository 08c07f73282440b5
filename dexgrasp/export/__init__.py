"""Export: a grasp as a trajectory at the controllers' rates, in files, with a check and a replay.

Takes a grasp file; gives rows of joint positions over time. It plans nothing.
"""
