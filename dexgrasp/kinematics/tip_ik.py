"""Inverse kinematics from three fingertip positions, hand on arm, compiled (damped least squares).

Clearances are left to the bilevel optimisation; here the tips go to their targets within the joint range, from several
starting postures.
"""

import numpy as np
from numba import njit

from dexgrasp.kinematics.damped import damped_step
from dexgrasp.kinematics.forward import empty_frames, forward_part, hand_jacobian, tip_jacobian, tip_positions
from dexgrasp.kinematics.tree import RobotTree
from dexgrasp_env.arrays import Array

_DAMPING = 1e-4
_LARGEST = 0.3  # rad a joint in a step
_POSTURE = 0.02  # share of the way back to the start in the null space, per step


@njit(cache=True, error_model="numpy")
def solve_tips(
    q: Array, targets: Array, tree: RobotTree, iterations: int, tolerance: float, fingers_only: bool = False
) -> float:
    """Move `q` (23,), in place, so that the tip centres meet `targets`; return the largest miss, m.

    Args:
        q: (23,) rad, start and result; joints stay within their range, the ring finger stays.
        targets: (3, 3) m, tip sphere centres of thumb, index, middle, world frame.
        tree: the robot.
        iterations: at most so many steps.
        tolerance: m, of the largest miss.
        fingers_only: keep the arm where it is.
    """
    frames = empty_frames(tree)
    start = q.copy()
    blocks = np.zeros((3, 3, 23))
    J, e = np.empty((9, 23)), np.empty(9)
    miss = 1e9
    for k in range(iterations + 1):
        forward_part(q, tree, frames, tree.palm + 1 if fingers_only and k > 0 else 0, tree.parent.shape[0])
        tips = tip_positions(tree, frames)
        miss = 0.0
        for i in range(3):
            squared = 0.0
            for r in range(3):
                e[3 * i + r] = targets[i, r] - tips[i, r]
                squared += e[3 * i + r] ** 2
            miss = max(miss, np.sqrt(squared))
        if miss < tolerance or k == iterations:
            return miss
        if fingers_only:
            hand_jacobian(tree, frames, tips, blocks)
        else:
            blocks = tip_jacobian(tree, frames, tips)
        for i in range(3):
            for r in range(3):
                J[3 * i + r] = blocks[i, r]
        _freeze_blocked(J, e, q, tree)
        step = damped_step(J, e, _DAMPING, _POSTURE * (start - q), _LARGEST)
        for j in range(23):
            q[j] = min(max(q[j] + step[j], tree.lower[j]), tree.upper[j])
    return miss


@njit(cache=True, error_model="numpy")
def _freeze_blocked(J: Array, e: Array, q: Array, tree: RobotTree) -> None:
    """Take joints out that stand at a limit and are pushed further."""
    push = J.T @ e
    for j in range(23):
        if (q[j] <= tree.lower[j] and push[j] < 0.0) or (q[j] >= tree.upper[j] and push[j] > 0.0):
            J[:, j] = 0.0
