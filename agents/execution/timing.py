"""When to be where: time-optimal within velocity and acceleration limits, by reachability analysis (TOPP-RA)."""

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.execution.collision import CollisionChecker, densify
from dexgrasp_env.robot.limits import ARM_ACCELERATION, VELOCITY
from dexgrasp_env.scene.constants import CONTROL_PERIOD

Array = NDArray[np.float64]
_HAND_ACCELERATION = 60.0  # rad/s^2; ours, the maker states none
ACCELERATION = np.concatenate([ARM_ACCELERATION, np.full(16, _HAND_ACCELERATION)])
_BLENDS = (0.15, 0.06, 0.02)  # rad: how far before a corner the turn begins, widest first
_SPACING = 0.03  # rad between the points of the path that is timed
_GRID = 120
_CUT = 0.001  # m


def time_path(path: Array, checker: CollisionChecker | None = None, speed: float = 0.65) -> Array:
    """Return set-points (T, 23) rad, one a control step, from rest to rest along a polyline.

    Corners are rounded where the checker finds the rounded path free; otherwise the motion halts at them.

    Args:
        path: (n, 23) rad; its first point is where the robot stands and is not repeated in the result.
        checker: of the scene, or None where roundings need no check.
        speed: share of the limits to use, above 0 and up to 1.
    """
    path = _without_repeats(path)
    if len(path) < 2:
        return path[:0]
    for blend in _BLENDS if len(path) > 2 else ():
        rounded = round_corners(path, blend)
        if checker is not None and checker.first_contact(rounded) is not None:
            continue
        timed = _time_smooth(rounded, speed)
        # Set-points go straight between control steps, so they cut the roundings a little.
        if checker is None or checker.first_contact(np.concatenate([path[:1], timed]), _CUT) is None:
            return timed
    return np.concatenate([_time_smooth(densify(leg, _SPACING), speed) for leg in _legs(path)])


def round_corners(path: Array, blend: float) -> Array:
    """Return the dense points of a polyline (n, 23) with parabolas from `blend` rad before its corners on."""
    points = [path[:1]]
    t = np.linspace(0.0, 1.0, 9)[:, None]
    for before, corner, after in zip(path[:-2], path[1:-1], path[2:], strict=True):
        into, out = corner - before, after - corner
        reach = [min(blend / np.linalg.norm(leg), 0.5) for leg in (into, out)]
        a, b = corner - reach[0] * into, corner + reach[1] * out
        points.append((1 - t) ** 2 * a + 2 * t * (1 - t) * corner + t**2 * b)
    points.append(path[-1:])
    return _without_repeats(densify(np.concatenate(points), _SPACING))


def _without_repeats(path: Array) -> Array:
    path = np.asarray(path, dtype=float)
    keep = np.concatenate([[True], np.abs(np.diff(path, axis=0)).max(axis=1) > 1e-6])
    return path[keep]


def _time_smooth(points: Array, speed: float) -> Array:
    """Time a dense smooth path by TOPP-RA; by a slow smooth law where that fails."""
    if len(points) < 4:
        points = np.concatenate([densify(leg, np.abs(leg[1] - leg[0]).max() / 3) for leg in _legs(points)])
        points = _without_repeats(points)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    trajectory = _toppra(points, length, speed)
    if trajectory is not None:
        count = max(1, int(np.ceil(trajectory.duration / CONTROL_PERIOD - 1e-9)))
        times = np.minimum(np.arange(1, count + 1) * CONTROL_PERIOD, trajectory.duration)
        samples = np.asarray(trajectory(times))
        samples[-1] = points[-1]
        if np.isfinite(samples).all() and within_limits(points[0], samples):
            return samples
    return _slow(points, length, speed)


def _legs(points: Array) -> list[Array]:
    return [points[i : i + 2] for i in range(len(points) - 1)]


def within_limits(start: Array, samples: Array) -> bool:
    """Whether set-points (T, 23) that follow `start` (23,) keep the velocity limits of the control step."""
    steps = np.abs(np.diff(np.concatenate([start[None], samples]), axis=0))
    return bool((steps <= VELOCITY * CONTROL_PERIOD + 1e-9).all())


def _toppra(points: Array, length: Array, speed: float) -> Any:
    """Return a trajectory of toppra, or None where it finds none."""
    import toppra
    from toppra import algorithm, constraint

    logging.getLogger("toppra").setLevel(logging.ERROR)
    curve = toppra.SplineInterpolator(length, points, bc_type="natural")
    velocity, acceleration = speed * VELOCITY, speed * ACCELERATION
    limits = [
        constraint.JointVelocityConstraint(np.stack([-velocity, velocity], axis=1)),
        constraint.JointAccelerationConstraint(
            np.stack([-acceleration, acceleration], axis=1),
            discretization_scheme=constraint.DiscretizationType.Interpolation,
        ),
    ]
    solver = algorithm.TOPPRA(
        limits,
        curve,
        gridpoints=np.linspace(0.0, length[-1], _GRID + 1),
        parametrizer="ParametrizeConstAccel",
    )
    return solver.compute_trajectory()


def _slow(points: Array, length: Array, speed: float) -> Array:
    """Quintic time law along the path, stretched until every set-point keeps the limits."""
    span = np.abs(np.diff(points, axis=0)).sum(axis=0)
    duration = max(float((2.0 * span / (speed * VELOCITY)).max()), 4 * CONTROL_PERIOD)
    while True:
        count = int(np.ceil(duration / CONTROL_PERIOD))
        at = smooth_step(np.arange(1, count + 1) / count) * length[-1]
        samples = np.stack([np.interp(at, length, points[:, j]) for j in range(points.shape[1])], axis=1)
        if within_limits(points[0], samples):
            return samples
        duration *= 1.3


def smooth_step(t: Array) -> Array:
    """Rise from 0 to 1 over t in [0, 1] with no velocity or acceleration at the ends."""
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2)
