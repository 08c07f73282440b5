"""Mechanics of a grasp: contacts and friction cones, wrenches, closure, margins, forces; kinematics of the robot.

Takes contact points, normals, a contact model (`contact_models`), friction, joint angles; gives the residual of Eq. 4
(`wrench`), forces, margins and poses. It never looks for a grasp.
"""
