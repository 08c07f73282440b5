"""Control modes: what actions in [-1, 1] mean for the set-points of the 23 joint servos; `kernel` computes them."""

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.limits import LOWER, UPPER, VELOCITY
from dexgrasp_env.scene.constants import CONTROL_PERIOD

CONTROL_MODES = ("joint_position", "joint_delta", "ee_delta")
ACTION_SIZE = {"joint_position": 23, "joint_delta": 23, "ee_delta": 22}
MAX_STEP = VELOCITY * CONTROL_PERIOD  # rad a control step, (23,)


def normalise(q: Array) -> Array:
    """Joint positions (..., 23) rad as `joint_position` actions (..., 23) in [-1, 1]."""
    return np.clip(2.0 * (q - LOWER) / (UPPER - LOWER) - 1.0, -1.0, 1.0)


def denormalise(action: Array) -> Array:
    """`joint_position` actions (..., 23) as joint positions (..., 23) rad."""
    return LOWER + 0.5 * (action + 1.0) * (UPPER - LOWER)
