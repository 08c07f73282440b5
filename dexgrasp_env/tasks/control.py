"""Control modes: actions in [-1, 1] to set-points of the 23 joint servos.

Functions of arrays with leading batch axes, (..., n). Set-points stay within the joint range and move at most at the
joint's velocity limit; between control steps the environment interpolates them.
"""

from collections.abc import Callable

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.limits import LOWER, UPPER, VELOCITY
from dexgrasp_env.scene.constants import CONTROL_PERIOD
from dexgrasp_env.tasks.constants import PALM_STEP, PALM_TURN

CONTROL_MODES = ("joint_position", "joint_delta", "ee_delta")
ACTION_SIZE = {"joint_position": 23, "joint_delta": 23, "ee_delta": 22}
MAX_STEP = VELOCITY * CONTROL_PERIOD  # rad a control step, (23,)
_DAMPING = 0.02  # of the least-squares inverse; keeps joint steps bounded near singularities
_POSTURE_GAIN = 0.05  # pull towards home in the arm's null space, per control step


def normalise(q: Array) -> Array:
    """Joint positions (..., 23) rad as `joint_position` actions (..., 23) in [-1, 1]."""
    return np.clip(2.0 * (q - LOWER) / (UPPER - LOWER) - 1.0, -1.0, 1.0)


def denormalise(action: Array) -> Array:
    """`joint_position` actions (..., 23) as joint positions (..., 23) rad."""
    return LOWER + 0.5 * (action + 1.0) * (UPPER - LOWER)


def limit(desired: Array, targets: Array) -> Array:
    """Keep the next set-points within the velocity limits of the current ones and within the joint range."""
    step = np.minimum(np.maximum(desired - targets, -MAX_STEP), MAX_STEP)
    return np.minimum(np.maximum(targets + step, LOWER), UPPER)


def joint_position(action: Array, targets: Array) -> Array:
    """Absolute joint positions over the joint range."""
    return limit(denormalise(action), targets)


def joint_delta(action: Array, targets: Array) -> Array:
    """Increments of the set-points; 1 is the velocity limit."""
    return limit(targets + action * MAX_STEP, targets)


def ee_delta(action: Array, targets: Array, palm_jacobian: Callable[[Array], Array], home: Array) -> Array:
    """Palm increments through differential inverse kinematics, and absolute finger positions.

    Args:
        action: (..., 22): palm translation and rotation vector in the robot base frame (6), finger positions (16).
        targets: current set-points, (..., 23) rad.
        palm_jacobian: set-points -> Jacobian of the palm (..., 6, 7), linear rows first.
        home: arm posture (7,) that the null space is pulled towards.
    """
    twist = action[..., :6] * np.array([PALM_STEP] * 3 + [PALM_TURN] * 3)
    J = palm_jacobian(targets)
    arm = targets[..., :7]
    # (J Jt + d I)^-1 once serves the task and the null-space projection.
    inverse = np.swapaxes(J, -1, -2) @ np.linalg.inv(J @ np.swapaxes(J, -1, -2) + _DAMPING**2 * np.eye(6))
    pull = _POSTURE_GAIN * (home - arm)
    posture = pull - (inverse @ (J @ pull[..., None]))[..., 0]
    step = (inverse @ twist[..., None])[..., 0] + posture
    # One factor for all joints keeps the direction of the palm's motion.
    excess = np.max(np.abs(step) / MAX_STEP[:7], axis=-1, keepdims=True)
    step = step / np.maximum(excess, 1.0)
    fingers = denormalise(np.concatenate([np.zeros_like(arm), action[..., 6:]], axis=-1))[..., 7:]
    return limit(np.concatenate([arm + step, fingers], axis=-1), targets)
