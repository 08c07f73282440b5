"""Control modes: what actions in [-1, 1] mean for the set-points of a robot's servos; `set_points` computes them."""

from typing import Protocol

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.robot import Robot
from dexgrasp_env.scene.constants import CONTROL_PERIOD

CONTROL_MODES = ("joint_position", "joint_delta", "ee_delta")


def action_size(mode: str, robot: Robot) -> int:
    """Return how many numbers an action of a control mode has."""
    return 6 + robot.dof - robot.arm_dof if mode == "ee_delta" else robot.dof


class Ranges(Protocol):
    """What has limits of n joints, rad and rad/s: a robot, or its kinematic tree."""

    @property
    def lower(self) -> Array:
        """(n,) rad."""

    @property
    def upper(self) -> Array:
        """(n,) rad."""

    @property
    def velocity(self) -> Array:
        """(n,) rad/s."""


def max_step(robot: Ranges) -> Array:
    """Return what set-points move by at most in a control step, (n,) rad."""
    return robot.velocity * CONTROL_PERIOD


def normalise(q: Array, robot: Ranges) -> Array:
    """Joint positions (..., n) rad as `joint_position` actions (..., n) in [-1, 1]."""
    return np.clip(2.0 * (q - robot.lower) / (robot.upper - robot.lower) - 1.0, -1.0, 1.0)


def denormalise(action: Array, robot: Ranges) -> Array:
    """`joint_position` actions (..., n) as joint positions (..., n) rad."""
    return robot.lower + 0.5 * (action + 1.0) * (robot.upper - robot.lower)
