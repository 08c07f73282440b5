"""Kinematics of the hand and the arm, with Jacobians and clearances."""
