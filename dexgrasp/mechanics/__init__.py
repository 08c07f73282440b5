"""Mechanics of a grasp: contacts and friction cones, wrenches, closure, margins, forces; kinematics of the robot.

Takes contact points, normals, friction (reserves: `grasp.thresholds`), joint angles; gives forces, margins and poses.
It never looks for a grasp.
"""
