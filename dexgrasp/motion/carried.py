"""Straight ways of what the hand holds, and letting go of it."""

import numpy as np

from dexgrasp.kinematics.palm_ik import palm_frame
from dexgrasp.kinematics.tree import RobotTree
from dexgrasp.motion.cartesian import shift_palm
from dexgrasp.motion.timing import eased, ramp, within_limits
from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import about_z

STILL = 0.001
"""m that count as no way."""
_SPEED = 0.01  # m a control step, on average
_SETTLE, _OPEN = 6, 14  # control steps before the hand opens, and of its opening


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
        timed = eased(points, count)
        if within_limits(targets, timed, tree):
            return timed, error
        count = int(1.3 * count) + 1


def let_go(held: Array, opened: Array) -> Array:
    """Return set-points (m, n) rad that come to rest at `held` (n,), and open the hand to `opened` (n,)."""
    return np.concatenate([np.repeat(held[None], _SETTLE, axis=0), ramp(held, opened, _OPEN)])
