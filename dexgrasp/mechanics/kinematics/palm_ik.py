"""Inverse kinematics of the arm for a pose or a path of the palm, compiled: damped least squares within the range."""

from collections.abc import Iterator

import numpy as np

from dexgrasp.mechanics.kinematics.damped import damped_step
from dexgrasp.mechanics.kinematics.forward import (
    Frames,
    add_columns,
    add_turn_row,
    body_frames,
    empty_frames,
    forward,
    forward_part,
    to_world,
)
from dexgrasp.mechanics.kinematics.tree import RobotTree
from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import njit

TURN_SCALE = 0.15
"""m a radian: how much a turn of the palm weighs against its shift."""
PALM_DOWN = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Rotation of a palm whose face looks down, fingers along x."""
_DAMPING = 1e-3
_CORRECTIONS = 4  # steps of Newton at every point of a path; two are enough away from singularities


@njit
def solve_palm(
    q: Array, R_goal: Array, p_goal: Array, tree: RobotTree, iterations: int, tolerance: float,
    steady: bool = False,
) -> float:  # fmt: skip
    """Move the arm's part of `q` (n,), in place, so that the palm frame meets a goal; return what error is left.

    Args:
        q: (n,) rad, start and result; the hand's part is not touched.
        R_goal: (3, 3) palm rotation in the world frame.
        p_goal: (3,) m.
        tree: the robot.
        iterations: at most so many steps.
        tolerance: m; a radian counts as 0.15 m.
        steady: without a pull towards the middle of the range: a path follows from where it starts, and does not drift.

    Returns:
        Norm of the remaining error, m.
    """
    frames = empty_frames(tree)
    R, p = frames.R, frames.p
    n = tree.arm
    e, J, point = np.empty(6), np.empty((6, n)), np.empty(3)
    error = 1e9
    for k in range(iterations + 1):
        palm = tree.palm
        forward_part(q, tree, frames, 0, palm + 1)  # the hand follows it
        to_world(R[palm], p[palm], tree.palm_offset, point)
        now = R[palm] @ tree.palm_rotation
        e[:3], e[3:] = p_goal - point, TURN_SCALE * _rotation_error(R_goal, now)
        error = np.sqrt((e * e).sum())
        if error < tolerance or k == iterations:
            return error
        palm_jacobian(tree, frames, J)
        # pull towards the middle of the range, in the null space only
        pull = (0.0 if steady else 2e-2) * (0.5 * (tree.lower[:n] + tree.upper[:n]) - q[:n])
        damping, inside = (1e-4, 0.0) if steady else (_DAMPING * min(error, 0.1), 1e-3)
        step = damped_step(J, e, damping, pull, 0.5)  # rad a joint in a step
        q[:n] = np.minimum(np.maximum(q[:n] + step, tree.lower[:n] + inside), tree.upper[:n] - inside)
    return error


def reach_palm(q: Array, R: Array, p: Array, tree: RobotTree) -> bool:
    """Solve the arm's part of `q` for a palm pose, in place, from the arm's starts; tell whether it is reached."""
    return any(True for _ in palm_postures(q, R, p, tree))


def palm_postures(q: Array, R: Array, p: Array, tree: RobotTree) -> Iterator[Array]:
    """Yield `q` itself with the arm's part solved for a palm pose, from each of the arm's starts that reaches it."""
    toward = np.arctan2(p[1], p[0])
    for start in tree.starts:
        q[: tree.arm] = start
        q[0] = np.clip(toward + start[0], tree.lower[0], tree.upper[0])
        if solve_palm(q, R, p, tree, 40, 1e-4) < 2e-3:  # m, error with which a palm pose counts as reached
            yield q


@njit
def palm_jacobian(tree: RobotTree, frames: Frames, J: Array) -> None:
    """Write the Jacobian (6, a) of the palm frame by the arm's joints: m/rad, turns times `TURN_SCALE`."""
    point, axes = np.empty(3), np.eye(3)
    to_world(frames.R[tree.palm], frames.p[tree.palm], tree.palm_offset, point)
    J[:] = 0.0
    add_columns(J, tree.palm, -1, point, tree, frames)
    for r in range(3):
        add_turn_row(J[3 + r], tree.palm, axes[r], TURN_SCALE, tree, frames)


@njit
def _rotation_error(goal: Array, now: Array) -> Array:
    """Rotation vector (3,) rad that takes `now` to `goal`, in the world frame."""
    D = goal @ now.T
    # The axis, twice the sine of the angle long.
    v = np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]])
    s = 0.5 * np.sqrt((v * v).sum())
    c = 0.5 * (D[0, 0] + D[1, 1] + D[2, 2] - 1.0)
    angle = np.arctan2(s, c)
    if s < 1e-9:
        # Half a turn apart, the axis is lost: any axis gets away from there.
        return np.array([0.0, 0.0, 0.5 * angle]) if c < 0.0 else 0.5 * v
    return v * (0.5 * angle / s)


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
    frames, start = empty_frames(tree), np.empty(3)
    forward(q, tree, frames)
    to_world(frames.R[tree.palm], frames.p[tree.palm], tree.palm_offset, start)
    turn = frames.R[tree.palm] @ tree.palm_rotation
    path, now, worst = np.empty((shifts.shape[0], q.shape[0])), q.copy(), 0.0
    for i in range(shifts.shape[0]):
        goal = start + shifts[i]
        worst = max(worst, solve_palm(now, turns[i] @ turn, goal, tree, _CORRECTIONS, 1e-6, True))
        path[i] = now
    return path, worst


def palm_frame(q: Array, tree: RobotTree) -> tuple[Array, Array]:
    """Return rotation (3, 3) and position (3,) m of the palm frame at `q` (n,) rad."""
    frames = body_frames(q, tree)
    R, p = frames.R[tree.palm], frames.p[tree.palm]
    return R @ tree.palm_rotation, p + R @ tree.palm_offset


def hanging_palm(axis: Array, tilt: Array | float) -> Array:
    """Return the rotations (..., 3, 3) of palms that face along level axes (..., 3), fingers hanging down.

    The thumb is tilted up by `tilt` (...) rad.
    """
    c, s = np.cos(tilt)[..., None], np.sin(tilt)[..., None]
    down = np.array([0.0, 0.0, -1.0])
    x, z = c * down - s * axis, s * down + c * axis
    return np.stack([x, np.cross(z, x), z], axis=-1)
