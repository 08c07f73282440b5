"""A grasp as a trajectory for a robot: rows at the controllers' rates, files, a check, a replay."""
