"""The step that all inverse kinematics here share: damped least squares (Wampler, 1986), compiled."""

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import njit


@njit
def damped_step(J: Array, e: Array, damping: float, pull: Array, largest: float) -> Array:
    """Return J^+ e + (I - J^+ J) pull with J^+ = J^T (J J^T + damping I)^-1, shortened to `largest` rad a joint.

    Args:
        J: (m, n) Jacobian of the task.
        e: (m,) error of the task.
        damping: what singular directions are damped with, in the task's units squared.
        pull: (n,) rad, wanted where the task leaves it open.
        largest: rad that a joint may move.
    """
    inverse = J.T @ np.linalg.inv(J @ J.T + damping * np.eye(J.shape[0]))
    step = inverse @ e + pull - inverse @ (J @ pull)
    most = np.abs(step).max()
    if most > largest:
        step *= largest / most
    return step
