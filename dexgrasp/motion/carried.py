"""Straight ways of what the hand holds."""

import numpy as np

from dexgrasp.kinematics.palm_ik import palm_frame
from dexgrasp.kinematics.tree import RobotTree
from dexgrasp.motion.cartesian import shift_palm
from dexgrasp.motion.timing import points_at, smooth_step, within_limits
from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import about_z

STILL = 0.001
"""m that count as no way."""
_SPEED = 0.01  # m a control step, on average


def carried(targets: Array, middle: Array, leg: Array, tree: RobotTree) -> tuple[Array, float]:
    """Move an object straight; about the robot's base, it turns along.

    Args:
        targets: (n,) rad, set-points before.
        middle: (3,) m, of the object.
        leg: (3,) m, the way.
        tree: the robot.

    Returns:
        Set-points (m, n) rad, one a control step, and the largest error of the palm, m.
    """
    if np.abs(leg).max() < STILL:
        return targets[None], 0.0
    ends = middle + np.linspace(0.0, 1.0, int(np.linalg.norm(leg) / _SPEED) + 2)[1:, None] * leg
    azimuths = np.arctan2(ends[:, 1], ends[:, 0]) - np.arctan2(middle[1], middle[0])
    turns = np.stack([about_z(angle) for angle in azimuths])
    arm = palm_frame(targets, tree)[1] - middle
    path, error = shift_palm(targets, tree, ends - middle + turns @ arm - arm, turns)
    points, count = np.concatenate([targets[None], path]), len(path)
    while True:
        at = smooth_step(np.arange(1, count + 1) / count) * len(path)
        timed = points_at(at, np.arange(0.0, len(points)), points)
        if within_limits(targets, timed, tree):
            return timed, error
        count = int(1.3 * count) + 1
