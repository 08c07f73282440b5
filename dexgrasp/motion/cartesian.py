"""Motions of the palm through differential inverse kinematics."""

import numpy as np

from dexgrasp.mechanics.kinematics.damped import damped_step
from dexgrasp.mechanics.kinematics.forward import empty_frames, forward, to_world
from dexgrasp.mechanics.kinematics.palm_ik import TURN_SCALE, palm_jacobian, twice_turned
from dexgrasp.mechanics.kinematics.tree import RobotTree
from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import njit

_CORRECTIONS = 4  # steps of Newton at every point; two are enough away from singularities


def shift_palm(q: Array, tree: RobotTree, shifts: Array, turns: Array | None = None) -> tuple[Array, float]:
    """Follow a path of the palm, fingers still, from `q` on.

    Args:
        q: (n,) rad.
        tree: the robot.
        shifts: (m, 3) m, palm positions relative to the one at `q`, about a centimetre from one to the next.
        turns: (m, 3, 3) its rotations since then, in the world frame; None to keep it as it is.

    Returns:
        Configurations (m, n) rad, within the joint range, and the largest error of the palm, m (a radian
        counts as 0.15 m).
    """
    shifts = np.ascontiguousarray(shifts, dtype=float)
    if turns is None:
        turns = np.repeat(np.eye(3)[None], len(shifts), axis=0)
    return _shift_palm(
        np.ascontiguousarray(q, dtype=float), tree, shifts, np.ascontiguousarray(turns, dtype=float)
    )


@njit
def _shift_palm(q: Array, tree: RobotTree, shifts: Array, turns: Array) -> tuple[Array, float]:
    frames, palm = empty_frames(tree), tree.palm
    R, p = frames.R, frames.p
    start, point = np.empty(3), np.empty(3)
    J, e, arm = np.empty((6, tree.arm)), np.empty(6), tree.arm
    forward(q, tree, frames)
    to_world(R[palm], p[palm], tree.palm_offset, start)
    turn = R[palm].copy()
    path, now, worst = np.empty((shifts.shape[0], q.shape[0])), q.copy(), 0.0
    for i in range(shifts.shape[0]):
        error = 0.0
        for step in range(_CORRECTIONS + 1):
            forward(now, tree, frames)
            to_world(R[palm], p[palm], tree.palm_offset, point)
            e[:3] = start + shifts[i] - point
            e[3:] = 0.5 * TURN_SCALE * twice_turned(turns[i] @ turn @ R[palm].T)
            error = np.sqrt((e * e).sum())
            if error < 1e-6 or step == _CORRECTIONS:
                break
            palm_jacobian(tree, frames, J)
            # No pull to a posture: the path must follow from where it starts, not drift.
            change = damped_step(J, e, 1e-4, np.zeros(arm), np.inf)
            now[:arm] = np.minimum(np.maximum(now[:arm] + change, tree.lower[:arm]), tree.upper[:arm])
        worst = max(worst, error)
        path[i] = now
    return path, worst
