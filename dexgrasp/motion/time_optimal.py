"""The fastest way along a path within velocity and acceleration limits, by reachability analysis, compiled.

Pham and Pham, "A new approach to time-optimal path parameterization based on reachability analysis", T-RO 2018
(TOPP-RA). With x the squared speed along the path and u the acceleration, q' u + q'' x is a joint's acceleration.
Backwards the largest x from which a stop at the end can still be reached; forwards the largest u that stays below.
Limits hold at both ends of every stretch between two grid points, where u is constant.
"""

from typing import NamedTuple

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import njit

_LARGE = 1e8


@njit
def _narrow(first: Array, second: Array, ahead: float, acceleration: Array, x: float, bounds: Array) -> float:
    """Narrow bounds (2, 2) on u to where |first u + second (x + ahead u)| <= acceleration at x.

    Row 0 of `bounds` is the largest lower bound and how it changes with x, row 1 the least upper one. Returned is the
    most that x may be for the sake of joints that u does not move.
    """
    most = _LARGE
    for j in range(first.shape[0]):
        c, d, a = first[j] + ahead * second[j], second[j], acceleration[j]
        if abs(c) < 1e-12:
            if abs(d) > 1e-12:
                most = min(most, a / abs(d))
            continue
        middle, half = -d / c, a / abs(c)
        if middle * x - half > bounds[0, 0]:
            bounds[0, 0], bounds[0, 1] = middle * x - half, middle
        if middle * x + half < bounds[1, 0]:
            bounds[1, 0], bounds[1, 1] = middle * x + half, middle
    return most


class _Curve(NamedTuple):
    """Derivatives of the joints along the path, and how hard they may accelerate."""

    first: Array  # (n, joints)
    second: Array  # (n, joints)
    acceleration: Array  # (joints,)


@njit
def _accelerations(i: int, x: float, curve: _Curve, ahead: float, most_next: float, bounds: Array) -> float:
    """Write the bounds of u at grid point i and squared speed x, with their slopes; return the most x may be at all."""
    bounds[0, 0], bounds[0, 1] = -x / ahead, -1.0 / ahead  # the next squared speed is within [0, most_next]
    bounds[1, 0], bounds[1, 1] = (most_next - x) / ahead, -1.0 / ahead
    here = _narrow(curve.first[i], curve.second[i], 0.0, curve.acceleration, x, bounds)
    there = _narrow(curve.first[i + 1], curve.second[i + 1], ahead, curve.acceleration, x, bounds)
    return min(here, there)


@njit
def fastest_squared_speeds(
    at: Array, first: Array, second: Array, velocity: Array, acceleration: Array
) -> Array:
    """Return squared speeds (n,) along the path, 0 at both ends; an empty array where there is none.

    Args:
        at: (n,) grid points along the path, increasing.
        first: (n, joints) first derivatives of the joints there. second: (n, joints) second ones.
        velocity: (joints,) limits. acceleration: (joints,) limits.
    """
    n, bounds, curve = at.shape[0], np.empty((2, 2)), _Curve(first, second, acceleration)
    most, x = np.zeros(n), np.zeros(n)
    for i in range(n - 2, -1, -1):
        most[i] = _LARGE
        for j in range(velocity.shape[0]):
            if abs(first[i, j]) > 1e-12:
                most[i] = min(most[i], (velocity[j] / first[i, j]) ** 2)
        ahead = 2.0 * (at[i + 1] - at[i])
        for _ in range(60):
            # The room between the bounds is concave in x: Newton's steps from above end at its zero.
            most[i] = min(most[i], _accelerations(i, most[i], curve, ahead, most[i + 1], bounds))
            room = bounds[1, 0] - bounds[0, 0]
            if room >= -1e-9:
                break
            slope = bounds[1, 1] - bounds[0, 1]
            if slope >= 0.0:
                return np.empty(0)
            most[i] = max(0.0, most[i] - room / slope)
        if room < -1e-6:
            return np.empty(0)
    for i in range(n - 1):
        ahead = 2.0 * (at[i + 1] - at[i])
        _accelerations(i, x[i], curve, ahead, most[i + 1], bounds)
        x[i + 1] = min(max(x[i] + ahead * bounds[1, 0], 0.0), most[i + 1])
    return x


def places_at(at: Array, squared: Array, period: float) -> Array:
    """Return where on the path one is after every period, (T,); the last is the end. Empty where the way halts."""
    speed, stretch = np.sqrt(squared), np.diff(at)
    both = speed[:-1] + speed[1:]
    if (both <= 1e-9).any():
        return np.empty(0)
    when = np.append(0.0, np.cumsum(2.0 * stretch / both))
    count = max(1, int(np.ceil(when[-1] / period - 1e-9)))
    time = np.minimum(period * np.arange(1, count + 1), when[-1])
    i = np.minimum(np.searchsorted(when[1:], time), len(at) - 2)
    late, change = time - when[i], np.diff(squared)[i] / (2.0 * stretch[i])
    places = np.minimum(at[i] + speed[i] * late + 0.5 * change * late * late, at[-1])
    places[-1] = at[-1]
    return places
