"""Time law on a path within limits of velocity, acceleration and jerk, sampled at a period.

The path is a spline through its points; how far along it the robot is follows a jerk-limited law (ruckig). A
trajectory stretched in time by k has 1/k of the velocity, 1/k^2 of the acceleration and 1/k^3 of the jerk, so the
factor that the limits ask for is known from one sampling.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dexgrasp.grasp.trajectory import limit_shares
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError


class Limits(NamedTuple):
    """Limits of n joints: rad/s, rad/s^2, rad/s^3."""

    velocity: Array
    acceleration: Array
    jerk: Array


def timed(path: Array, limits: Limits, tick: float, multiple: int = 1) -> Array:
    """Return rows (T, n) rad along a path, one a `tick`, from rest at its first point to rest at its last.

    Args:
        path: (m, n) rad.
        limits: of the joints.
        tick: s between rows.
        multiple: T is a multiple of it, the end being held.

    Returns:
        The rows after the first point of the path; none where the path goes nowhere.

    Raises:
        InputError: if no law keeps the limits.
    """
    points = _thinned(path)
    if len(points) < 2:
        return points[:0]
    spline, length = _spline(points)
    slow = 1.0
    for _ in range(20):
        rows = spline(_law(length, slow, tick))
        rows[-1] = points[-1]
        used = np.array(limit_shares(np.concatenate([points[:1], rows]), tick, *limits))
        # Share of every limit that is planned for; finite differences of the rows then stay below 0.95.
        # k times slower, velocity, acceleration and jerk fall k, k^2 and k^3 times.
        excess = (used ** (1.0 / np.arange(1, 4))).max() / 0.90
        if excess <= 1.0:
            return np.concatenate([rows, np.repeat(rows[-1:], -len(rows) % multiple, axis=0)])
        slow *= 1.02 * excess
    raise InputError("the path cannot be timed within the limits of the joints: it bends too sharply")


def _thinned(path: Array) -> Array:
    kept = [path[0]]
    apart = 0.004  # rad: nearer points bend the spline for nothing
    for point in path[1:-1]:
        if np.abs(point - kept[-1]).max() >= apart and np.abs(point - path[-1]).max() >= apart:
            kept.append(point)
    if np.abs(path[-1] - kept[-1]).max() > 1e-9:
        kept.append(path[-1])
    return np.array(kept)


def _spline(points: Array) -> tuple[Callable[[Array], Array], float]:
    """Return a smooth curve through the points by its length along their polygon, and that length."""
    from scipy.interpolate import make_interp_spline

    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    degree = {2: 1, 3: 2, 4: 3, 5: 3}.get(len(points), 5)
    return make_interp_spline(along, points, k=degree), float(along[-1])


def _law(length: float, slow: float, tick: float) -> Array:
    """Return positions (T,) along a path of some length, jerk-limited, one a tick after the start."""
    from ruckig import InputParameter, Ruckig, Trajectory

    parameters, trajectory = InputParameter(1), Trajectory(1)
    parameters.current_position, parameters.target_position = [0.0], [length]
    for name in ("current_velocity", "current_acceleration", "target_velocity", "target_acceleration"):
        setattr(parameters, name, [0.0])
    parameters.max_velocity, parameters.max_acceleration = [2.0 / slow], [8.0 / slow**2]
    parameters.max_jerk = [200.0 / slow**3]
    Ruckig(1).calculate(parameters, trajectory)
    times = tick * np.arange(1, int(np.ceil(trajectory.duration / tick)) + 1)
    return np.array([min(trajectory.at_time(min(t, trajectory.duration))[0][0], length) for t in times])
