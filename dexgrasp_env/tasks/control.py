"""Control modes: what actions in [-1, 1] mean for the set-points of a robot's servos; `set_points` computes them."""

from typing import Protocol

import numpy as np
from gymnasium import spaces

from dexgrasp_env.arrays import AnyArray, Array, Single, numbers
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.robot import Robot
from dexgrasp_env.scene.constants import CONTROL_PERIOD, CONTROL_STEPS
from dexgrasp_env.valid import check

DIRECT_MODES = ("joint_position", "joint_delta", "ee_delta")
"""Those whose actions say at once where set-points go."""
ONCE_MODES = ("grasp_once", "table_grasp_once")
"""Those whose action is a whole grasp, about the object or at a place on the table."""
GRASP_MODES = ("grasp", *ONCE_MODES)
"""Those of the grasp space, `grasp_space`."""
CONTROL_MODES = (*DIRECT_MODES, *GRASP_MODES)
GRASP_SIZE = 7


class ActionSpace(spaces.Box):
    """Action space of a control mode with its settings: a policy that is saved with it says what its actions mean."""

    def __init__(
        self,
        control_mode: str,
        robot: Robot,
        frame_skip: int = CONTROL_STEPS,
        scale: float = 1.0,
        hold: int = 1,
    ) -> None:
        super().__init__(-1.0, 1.0, (action_size(control_mode, robot),), np.float32)
        self.control_mode, self.frame_skip = control_mode, frame_skip
        self.action_scale, self.hold = scale, hold


def action_size(mode: str, robot: Robot) -> int:
    """Return how many numbers an action of a control mode has."""
    if mode in GRASP_MODES:
        return GRASP_SIZE
    return 6 + robot.dof - robot.arm_dof if mode == "ee_delta" else robot.dof


class Ranges(Protocol):
    """Limits of n joints, rad and rad/s: of a robot, or of its kinematic tree."""

    @property
    def lower(self) -> Array:
        """(n,) rad."""

    @property
    def upper(self) -> Array:
        """(n,) rad."""

    @property
    def velocity(self) -> Array:
        """(n,) rad/s."""


def max_step(robot: Ranges, period: float = CONTROL_PERIOD) -> Array:
    """Return what set-points move by at most in a control step of `period` s, (n,) rad."""
    return robot.velocity * period


def normalise(q: Array, robot: Ranges) -> Array:
    """Joint positions (..., n) rad as `joint_position` actions (..., n) in [-1, 1]."""
    return np.clip(2.0 * (q - robot.lower) / (robot.upper - robot.lower) - 1.0, -1.0, 1.0)


def check_actions(action: Single, shape: tuple[int, ...] | None) -> Array:
    """Return a copy of actions of the right shape, in double precision.

    Raises:
        InputError: if they are no numbers, or their shape is wrong.
    """
    if not (isinstance(action, np.ndarray) and action.dtype.kind == "f"):
        action = check("action", action, numbers(f"numbers of shape {shape}"))
    if action.shape != shape:
        raise InputError(f"action has shape {action.shape}: valid is {shape}")
    return np.array(action, np.float64)


def check_finite(actions: AnyArray) -> None:
    """Raise an InputError for actions that are not finite."""
    bad = np.argwhere(~np.isfinite(actions)).tolist()
    if bad:
        raise InputError(f"action has NaN or infinite entries at {bad}")
