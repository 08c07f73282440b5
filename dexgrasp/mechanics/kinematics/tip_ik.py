"""Inverse kinematics from fingertip positions, hand on arm, compiled (damped least squares).

Clearances are left to the bilevel optimisation; here the tips go to their targets within the joint range, from several
starting postures.
"""

import numpy as np

from dexgrasp.mechanics.kinematics.damped import damped_step
from dexgrasp.mechanics.kinematics.forward import (
    contact_jacobian,
    empty_frames,
    follow,
    forward_part,
    tip_positions,
)
from dexgrasp.mechanics.kinematics.tree import RobotTree
from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import njit


@njit
def solve_tips(
    q: Array, targets: Array, tree: RobotTree, iterations: int, tolerance: float, fingers_only: bool = False
) -> float:
    """Move `q` (n,), in place, so that the tip centres meet `targets`; return the largest miss, m.

    Args:
        q: (n,) rad, start and result; joints stay within their range, idle fingers stay.
        targets: (g, 3) m, tip sphere centres of the grasping fingers, world frame.
        tree: the robot.
        iterations: at most so many steps.
        tolerance: m, of the largest miss.
        fingers_only: keep the arm where it is.
    """
    frames = empty_frames(tree)
    start = q.copy()
    g, n = tree.tip_body.shape[0], q.shape[0]
    blocks = np.empty((g, 3, n))
    miss = 1e9
    for k in range(iterations + 1):
        forward_part(q, tree, frames, tree.palm + 1 if fingers_only and k > 0 else 0, tree.parent.shape[0])
        tips = tip_positions(tree, frames)
        gaps = targets - tips
        miss = np.sqrt((gaps * gaps).sum(1)).max()
        if miss < tolerance or k == iterations:
            return miss
        contact_jacobian(tree, frames, tips, tips, tree.palm if fingers_only else -1, blocks)
        J, e = blocks.reshape(3 * g, n), gaps.ravel()
        _freeze_blocked(J, e, q, tree)
        # share of the way back to the start in the null space, per step
        step = damped_step(J, e, 1e-4, 0.02 * (start - q), 0.3)  # rad a joint in a step
        q[:] = np.minimum(np.maximum(q + step, tree.lower), tree.upper)
        follow(q, tree)
    return miss


@njit
def _freeze_blocked(J: Array, e: Array, q: Array, tree: RobotTree) -> None:
    """Take joints out that stand at a limit and are pushed further."""
    push = J.T @ e
    for j in range(q.shape[0]):
        if (q[j] <= tree.lower[j] and push[j] < 0.0) or (q[j] >= tree.upper[j] and push[j] > 0.0):
            J[:, j] = 0.0
