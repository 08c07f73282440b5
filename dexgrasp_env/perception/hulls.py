"""Hulls of points and what they say of a shape: how deep points lie in them, how slim, how hollow what was seen is.

Heights are over the table, z = 0.
"""

from contextlib import suppress
from typing import Any

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.perception.cloud import thinned
from dexgrasp_env.perception.neighbourhoods import gaps_between

THIN = 0.004
"""m, to which points are thinned before they are compared."""


def longest_side(points: Array) -> float:
    """Return the longest side, m, of the box around points (N, 3)."""
    return float(max(map(np.ptp, points.T)))  # axis by axis: ten times as fast as all at once


def hull_of(points: Array) -> Any:
    """Return the convex hull (scipy's) of points (N, n), or None where they span none."""
    from scipy.spatial import ConvexHull, QhullError

    with suppress(QhullError, ValueError):
        return ConvexHull(points)
    return None


def corners_and_volume(points: Array) -> tuple[Array, float]:
    """Return the corners of the hull of points (N, 3) m and its volume, m3; all, and 0, for what is flat."""
    hull = hull_of(points)
    return (points, 0.0) if hull is None else (points[hull.vertices], float(hull.volume))


def volume_of(points: Array) -> float:
    """Return the volume, m3, of the hull of points (N, 3) m."""
    return corners_and_volume(points)[1]


def beyond(hull: Any, points: Array) -> Array:
    """Return how far points (N, n) lie outside a hull (N,), below 0 inside."""
    return np.asarray((points @ hull.equations[:, :-1].T + hull.equations[:, -1]).max(1))


def low_and_high(points: Array) -> tuple[float, float]:
    """Return between which heights, m, all but 2 % at either end of points (N, 3) lie."""
    low, high = np.quantile(points[:, 2], (0.02, 0.98))
    return float(low), float(high)


def deep_share(points: Array) -> float:
    """Return the share of points (N, 3) m that lie deep, 1 cm, inside their convex hull: of convex things none does."""
    points = points[thinned(points, THIN)]
    hull = hull_of(points)
    return 0.0 if hull is None else float((beyond(hull, points) < -0.010).mean())


def width_of(points: Array) -> float:
    """Return how wide, m, points (N, 3) are seen from above, across the way in which they reach farthest."""
    flat = points[:, :2] - points[:, :2].mean(0)
    return float(np.ptp(flat @ np.linalg.eigh(flat.T @ flat)[1][:, 0]))


def is_slim(points: Array) -> bool:
    """Return true for points (N, 3) m more than five times as high as wide, which do not stand by themselves."""
    return bool(np.ptp(points[:, 2]) > 5.0 * width_of(points))


def is_hollow(points: Array) -> bool:
    """Return true for points (N, 3) m that end in a rim around what is lower."""
    top = low_and_high(points)[1]
    rim = points[points[:, 2] > top - max(0.012, 0.15 * top), :2]
    rim = rim[thinned(rim, THIN)]
    around, whole, width = hull_of(rim), hull_of(points[:, :2]), np.ptp(rim, axis=0).min()
    if around is None or width < 0.04 or around.volume < 0.6 * whole.volume:
        return False
    wall = max(0.012, 0.12 * width)  # m from its outline within which a rim lies
    on_it = beyond(around, rim) > -wall
    corners = rim[around.vertices]
    sides = np.roll(corners, -1, axis=0) - corners
    places = np.linspace(0.0, 1.0, 16)  # of each side
    outline = (corners + places[:, None, None] * sides).reshape(-1, 2)
    length = np.tile(np.linalg.norm(sides, axis=1), len(places))
    seen = gaps_between(outline, rim[on_it]) < wall
    return bool(on_it.mean() > 0.85 and length[seen].sum() > 0.65 * length.sum())
