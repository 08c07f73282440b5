"""Timing of paths: time-optimal within the limits, by reachability analysis (TOPP-RA)."""

import numpy as np
from scipy.interpolate import CubicSpline

from dexgrasp.mechanics.kinematics.tree import RobotTree
from dexgrasp.motion.collision import CollisionChecker
from dexgrasp.motion.time_optimal import fastest_squared_speeds, places_at
from dexgrasp_env.arrays import Array
from dexgrasp_env.scene.constants import CONTROL_PERIOD

SPEED = 0.65
"""Share of the limits of velocity and acceleration that ways use."""


def time_path(
    path: Array, tree: RobotTree, checker: CollisionChecker | None = None, speed: float = SPEED
) -> Array:
    """Return set-points (T, n) rad, one a control step, from rest to rest along a polyline.

    Corners are rounded where the checker finds the rounded path free; otherwise the motion halts at them.

    Args:
        path: (m, n) rad; its first point is where the robot stands and is not repeated in the result.
        tree: the robot.
        checker: of the scene, or None where roundings need no check.
        speed: share of the limits to use, above 0 and up to 1.
    """
    path = np.asarray(path, dtype=float)
    path = path[np.append(True, np.abs(np.diff(path, axis=0)).max(axis=1) > 1e-6)]  # without repeats
    if len(path) < 2:
        return path[:0]
    # rad along the path: how far before a corner the turn begins, widest first
    for blend in (0.3, 0.15, 0.06) if len(path) > 2 else ():
        rounded, at = round_corners(path, blend)
        if checker is not None and checker.first_contact(rounded) is not None:
            continue
        timed = _fastest(rounded, at, tree, speed)
        if timed is None:
            continue
        # Set-points go straight between control steps, so they cut the roundings a little.
        if checker is None or checker.first_contact(np.vstack([path[0], timed]), 0.001) is None:  # m
            return timed
    legs = (round_corners(path[i : i + 2], 0.0) for i in range(len(path) - 1))
    return np.concatenate([_straight(*leg, tree, speed) for leg in legs])


def round_corners(path: Array, blend: float) -> tuple[Array, Array]:
    """Round the corners of a polyline by parabolas that begin and end `blend` rad from them, or half way.

    Args:
        path: (k, n) rad, no two successive points alike.
        blend: rad along the path.

    Returns:
        Points (m, n) of the rounded path, and where they are, (m,) rad along the polyline. In that measure,
        unlike in the length of the rounded path, the second derivative is bounded even at reversals.
    """
    ways = np.diff(path, axis=0)
    legs = np.linalg.norm(ways, axis=1)
    corners = np.concatenate([[0.0], np.cumsum(legs)])
    tangents = ways / legs[:, None]
    # rad along the path between the points that are timed
    at = np.linspace(0.0, corners[-1], max(20, int(np.ceil(corners[-1] / 0.015)) + 1))
    points = points_at(at, corners, path)
    for i in range(1, len(path) - 1):
        reach = min(blend, 0.5 * legs[i - 1], 0.5 * legs[i])
        near = np.abs(at - corners[i]) < reach
        along = (at[near] - corners[i] + reach)[:, None]
        turn = (tangents[i] - tangents[i - 1]) * along**2 / (4.0 * reach)
        points[near] = path[i] + tangents[i - 1] * (along - reach) + turn
    return points, at


def _fastest(points: Array, at: Array, tree: RobotTree, speed: float) -> Array | None:
    """Time a smooth path as fast as limits allow; None where set-points would break them."""
    curve = CubicSpline(at, points, bc_type="natural")
    room = 0.99  # of the limits: the solver keeps them to rounding
    squared = fastest_squared_speeds(
        at, curve(at, 1), curve(at, 2), room * speed * tree.velocity, room * speed * tree.acceleration
    )
    places = places_at(at, squared, CONTROL_PERIOD) if len(squared) else squared
    if len(places):
        samples = curve(places)
        samples[-1] = points[-1]
        if np.isfinite(samples).all() and is_gentle(points[0], samples, tree, speed):
            return samples
    return None


def _straight(points: Array, at: Array, tree: RobotTree, speed: float) -> Array:
    """Time a straight line as fast as limits allow; by a slow smooth law where that fails."""
    timed = _fastest(points, at, tree, speed)
    return _slow(points, at, tree, speed) if timed is None else timed


def within_limits(start: Array, samples: Array, tree: RobotTree) -> bool:
    """Return True if set-points (T, n) that follow `start` (n,) keep the velocity limits of the control step."""
    steps = np.abs(np.diff(samples, axis=0, prepend=start[None]))
    return bool((steps <= tree.velocity * CONTROL_PERIOD + 1e-9).all())


def is_gentle(start: Array, samples: Array, tree: RobotTree, speed: float) -> bool:
    """Return True if set-points, from rest to rest, keep the limits of velocity and acceleration."""
    rest = np.vstack([start, start, samples, samples[-1]])
    change = np.abs(np.diff(rest, n=2, axis=0)) / CONTROL_PERIOD**2
    # acceleration of the sampled set-points over what was asked for
    return bool((change <= 1.1 * speed * tree.acceleration).all()) and within_limits(start, samples, tree)


def _slow(points: Array, at: Array, tree: RobotTree, speed: float) -> Array:
    """Quintic time law along the path, stretched until every set-point keeps the limits."""
    span = np.abs(np.diff(points, axis=0)).sum(axis=0)
    duration = max((2.0 * span / (speed * tree.velocity)).max(), 4 * CONTROL_PERIOD)
    while True:
        count = int(np.ceil(duration / CONTROL_PERIOD))
        samples = points_at(smooth_steps(count) * at[-1], at, points)
        if is_gentle(points[0], samples, tree, speed):
            return samples
        duration *= 1.2


def points_at(at: Array, places: Array, path: Array) -> Array:
    """Return points (m, n) of a polyline, `at` (m,) its corners `path` (k, n) being at `places` (k,)."""
    return np.stack([np.interp(at, places, column) for column in path.T], axis=1)


def smooth_steps(count: int) -> Array:
    """Return `count` shares up to 1 of a way from rest to rest: no velocity or acceleration at its ends."""
    t = np.arange(1, count + 1) / count
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2)


def eased(path: Array, count: int) -> Array:
    """Return `count` set-points (count, n) from rest at the first point of a path to rest at its last."""
    return points_at(smooth_steps(count) * (len(path) - 1), np.arange(0.0, len(path)), path)


def still(q: Array, seconds: float) -> Array:
    """Return set-points (T, n) that stay at `q` (n,)."""
    return np.repeat(q[None], round(seconds / CONTROL_PERIOD), axis=0)


def ramp(a: Array, b: Array, count: int) -> Array:
    """Return `count` set-points (count, n) that go evenly from `a` (n,) to `b`."""
    return a + np.arange(1, count + 1)[:, None] / count * (b - a)
