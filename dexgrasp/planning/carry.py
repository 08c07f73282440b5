"""Plan the turn of an object once it is off the table, so that contacts bear it rather than their friction.

As it lies, the line between thumb and fingers is level, and friction bears the weight and whatever pushes downwards.
Turned about a level axis, some of that presses on fingertips instead. Of a few turns the one is taken after which the
contacts bear the largest push, if that is worth the way.
"""

from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from dexgrasp.grasp.grasp import Grasp
from dexgrasp.grasp.trajectory import ActionScript
from dexgrasp.mechanics.contacts import Contacts
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.strength import capacity_of
from dexgrasp.motion.carried import Turn, turn_arm
from dexgrasp.planning.holding import DOWN, contacts_of, robust_squeeze
from dexgrasp.planning.settings import GraspProblem
from dexgrasp_env.arrays import Array, cube_directions

ENOUGH = 4.0
"""Capacity, in weights, from which on an object is carried as it was lifted."""


def plan_turn(grasp: Grasp, script: ActionScript, problem: GraspProblem) -> Turn | None:
    """Return the turn after the lift that wins most, None where none wins enough, can be made, or is gentle enough.

    Args:
        grasp: with its certificate.
        script: that lifts it.
        problem: the object where it lies, and the robot; of the settings friction and torque limits.
    """
    target, tree = problem.target, problem.tree
    # What shifts in the hand on the way weighs on one finger: it would press harder than is asked for.
    if grasp.certificate.capacity >= ENOUGH or problem.settings.max_force is not None:
        return None
    contacts, _ = contacts_of(grasp.q, problem, problem.settings.friction_squeeze)
    start = script.phases["lift"][-1]
    centre = target.centre + palm_frame(start, tree)[1] - palm_frame(grasp.q, tree)[1]
    corners, pushes = target.corners - target.centre, cube_directions()
    arm, down, most = None, DOWN, capacity_of(contacts) + 0.1  # weights that a turn must win
    tilts, axes = np.deg2rad([60.0, 45.0, 30.0]), np.deg2rad(np.arange(0.0, 360.0, 30.0))
    cost = 0.06  # weights a radian: of two turns that win as much the shorter
    for angle, azimuth in product(tilts, axes):
        vector = angle * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        R = Rotation.from_rotvec(vector).as_matrix()
        worth = capacity_of(_turned(contacts, R), most + cost * angle, pushes) - cost * angle
        if worth <= most:
            continue
        way = turn_arm(start, vector, centre, corners, problem.cell, target.around)
        if way is not None:
            arm, most, down = way, worth, R.T @ DOWN
    if arm is None:
        return None
    squeeze = robust_squeeze(contacts, problem, down)
    return Turn(arm, squeeze.forces) if squeeze.share >= 1.0 else None


def _turned(contacts: Contacts, R: Array) -> Contacts:
    J = np.concatenate([R @ contacts.jacobians[:, :3], contacts.jacobians[:, 3:]], axis=1)
    return contacts._replace(
        points=contacts.points @ R.T, normals=contacts.normals @ R.T, centre=R @ contacts.centre, jacobians=J
    )
