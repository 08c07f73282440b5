"""Straight motions of the palm through differential inverse kinematics."""

import numpy as np
from numba import njit

from agents.kinematics.forward import add_row, add_turn_row, empty_frames, forward, to_world
from agents.kinematics.tree import RobotTree
from dexgrasp_env.arrays import Array

_TURN_SCALE = 0.15  # m a radian
_DAMPING = 1e-4
_CORRECTIONS = 4  # steps of Newton at every point; two are enough away from singularities


def shift_palm(q: Array, tree: RobotTree, shifts: Array) -> tuple[Array, float]:
    """Follow a path of the palm without turning it, fingers still, from `q` on.

    Args:
        q: (23,) rad.
        tree: the robot.
        shifts: (n, 3) m, palm positions relative to the one at `q`, about a centimetre from one to the next.

    Returns:
        Configurations (n, 23) rad, within the joint range, and the largest error of the palm, m (a radian
        counts as 0.15 m).
    """
    return _shift_palm(np.ascontiguousarray(q, dtype=float), tree, np.ascontiguousarray(shifts, dtype=float))


@njit(cache=True, error_model="numpy")
def _shift_palm(q: Array, tree: RobotTree, shifts: Array) -> tuple[Array, float]:
    frames, palm = empty_frames(tree), tree.palm
    R, p = frames.R, frames.p
    start, point, unit, row = np.empty(3), np.empty(3), np.zeros(3), np.empty(23)
    J, e = np.empty((6, 7)), np.empty(6)
    forward(q, tree, frames)
    to_world(R[palm], p[palm], tree.palm_offset, start)
    turn = R[palm].copy()
    path, now, worst = np.empty((shifts.shape[0], 23)), q.copy(), 0.0
    for i in range(shifts.shape[0]):
        error = 0.0
        for step in range(_CORRECTIONS + 1):
            forward(now, tree, frames)
            to_world(R[palm], p[palm], tree.palm_offset, point)
            D = turn @ R[palm].T
            for r in range(3):
                e[r] = start[r] + shifts[i, r] - point[r]
            e[3] = 0.5 * _TURN_SCALE * (D[2, 1] - D[1, 2])
            e[4] = 0.5 * _TURN_SCALE * (D[0, 2] - D[2, 0])
            e[5] = 0.5 * _TURN_SCALE * (D[1, 0] - D[0, 1])
            error = np.sqrt((e * e).sum())
            if error < 1e-6 or step == _CORRECTIONS:
                break
            for r in range(3):
                unit[:] = 0.0
                unit[r] = 1.0
                row[:] = 0.0
                add_row(row, palm, point, unit, 1.0, tree, frames)
                J[r] = row[:7]
                row[:] = 0.0
                add_turn_row(row, palm, unit, 1.0, tree, frames)
                J[3 + r] = _TURN_SCALE * row[:7]
            change = J.T @ np.linalg.solve(J @ J.T + _DAMPING * np.eye(6), e)
            for j in range(7):
                now[j] = min(max(now[j] + change[j], tree.lower[j]), tree.upper[j])
        worst = max(worst, error)
        path[i] = now
    return path, worst
