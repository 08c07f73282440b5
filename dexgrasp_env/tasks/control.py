"""Control modes: what actions in [-1, 1] mean for the set-points of a robot's servos; `set_points` computes them."""

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.active import active_cell
from dexgrasp_env.robot.robot import Robot
from dexgrasp_env.scene.constants import CONTROL_PERIOD

_ROBOT = active_cell().robot
CONTROL_MODES = ("joint_position", "joint_delta", "ee_delta")


def action_size(mode: str, robot: Robot) -> int:
    """Return how many numbers an action of a control mode has."""
    return 6 + robot.dof - robot.arm_dof if mode == "ee_delta" else robot.dof


def max_step(robot: Robot) -> Array:
    """Return what set-points move by at most in a control step, (n,) rad."""
    return robot.velocity * CONTROL_PERIOD


def normalise(q: Array, robot: Robot = _ROBOT) -> Array:
    """Joint positions (..., n) rad as `joint_position` actions (..., n) in [-1, 1]."""
    return np.clip(2.0 * (q - robot.lower) / (robot.upper - robot.lower) - 1.0, -1.0, 1.0)


def denormalise(action: Array, robot: Robot = _ROBOT) -> Array:
    """`joint_position` actions (..., n) as joint positions (..., n) rad."""
    return robot.lower + 0.5 * (action + 1.0) * (robot.upper - robot.lower)


MAX_STEP = max_step(active_cell().robot)
