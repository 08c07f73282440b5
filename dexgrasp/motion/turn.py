"""A turn of hand and object about the object's centre, in the air: what friction held comes to lie on fingers."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.kinematics.palm_ik import palm_frame
from dexgrasp.kinematics.tree import robot_tree
from dexgrasp.motion.cartesian import shift_palm
from dexgrasp.motion.collision import CollisionChecker
from dexgrasp.motion.timing import smooth_steps, within_limits
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.scene.constants import CONTROL_PERIOD

_SECONDS = 1.15  # s a radian
_LEAST_SECONDS = 0.6
_STRAY = 0.005  # m that the palm may be off its way; a radian counts as 0.15 m


class Turn(NamedTuple):
    """What follows the lift."""

    arm: Array  # (m, a) rad, set-points of the arm, one a control step
    forces: (
        Array  # (3, 3) N on the object, to press with at its end; in the axes that the grasp has before it
    )


def turn_arm(
    start: Array,
    vector: Array,
    centre: Array,
    corners: Array,
    cell: Cell,
    around: ConvexDistance | None = None,
) -> Array | None:
    """Return set-points (m, a) rad that turn hand and object, None where the arm or the table is in the way.

    The object's centre rises as far as keeps its lowest corner where it is.

    Args:
        start: (n,) rad, set-points before.
        vector: (3,) rad, rotation vector.
        centre: (3,) m, of the object.
        corners: (K, 3) m, of the object, from its centre.
        cell: of the robot.
        around: what stands on the table, in the way of hand and object; None where there is nothing.
    """
    tree = robot_tree(cell)
    count = round(max(_SECONDS * float(np.linalg.norm(vector)), _LEAST_SECONDS) / CONTROL_PERIOD)
    turns = Rotation.from_rotvec(smooth_steps(count)[:, None] * vector).as_matrix()
    low = (turns @ corners.T)[:, 2].min(axis=1)
    arm = palm_frame(start, tree)[1] - centre
    shifts = turns @ arm - arm
    shifts[:, 2] += np.maximum.accumulate(np.maximum(corners[:, 2].min() - low, 0.0))
    path, strayed = shift_palm(start, tree, shifts, turns)
    if strayed > _STRAY or not within_limits(start, path, tree):
        return None
    if CollisionChecker(cell, around, 0.0).first_contact(np.vstack([start, path])) is not None:
        return None
    if around is not None:
        middles = centre + shifts + arm - turns @ arm
        moved = (turns @ corners.T).transpose(0, 2, 1) + middles[:, None]
        if around.distance(moved.reshape(-1, 3)).min() < 0.0:
            return None
    return path[:, : tree.arm]
