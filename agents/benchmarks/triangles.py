"""Exact distances to a triangle mesh, in numba; import inside functions only."""

import numpy as np
from numba import njit

from dexgrasp_env.arrays import Array


@njit(cache=True)
def surface_distances(points: Array, triangles: Array) -> Array:
    """Return the distance of each point (M, 3) to the nearest of the triangles (F, 3, 3)."""
    centres = np.empty((len(triangles), 3))
    radii = np.zeros(len(triangles))
    for f in range(len(triangles)):
        for a in range(3):
            centres[f, a] = (triangles[f, 0, a] + triangles[f, 1, a] + triangles[f, 2, a]) / 3.0
        for v in range(3):
            radii[f] = max(radii[f], np.sqrt(((triangles[f, v] - centres[f]) ** 2).sum()))
    distances = np.empty(len(points))
    for i in range(len(points)):
        best = np.inf
        for f in range(len(triangles)):
            d2 = 0.0
            for a in range(3):
                d2 += (points[i, a] - centres[f, a]) ** 2
            # The triangle lies in its ball: no need to look closer when the ball is too far.
            if d2 < (best + radii[f]) ** 2:
                best = min(
                    best, _triangle_distance(points[i], triangles[f, 0], triangles[f, 1], triangles[f, 2])
                )
        distances[i] = best
    return distances


@njit(cache=True)
def _dot(a: Array, b: Array) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def _segment_distance(p: Array, a: Array, b: Array) -> float:
    ab, ap = b - a, p - a
    t = min(max(_dot(ap, ab) / max(_dot(ab, ab), 1e-300), 0.0), 1.0)
    d = ap - t * ab
    return np.sqrt(_dot(d, d))


@njit(cache=True)
def _triangle_distance(p: Array, a: Array, b: Array, c: Array) -> float:
    ab, ac, ap = b - a, c - a, p - a
    d00, d01, d11 = _dot(ab, ab), _dot(ab, ac), _dot(ac, ac)
    d20, d21 = _dot(ap, ab), _dot(ap, ac)
    det = d00 * d11 - d01 * d01
    if det > 0.0:
        v, w = (d11 * d20 - d01 * d21) / det, (d00 * d21 - d01 * d20) / det
        if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
            d = ap - v * ab - w * ac
            return np.sqrt(_dot(d, d))
    edges = min(_segment_distance(p, a, b), _segment_distance(p, b, c))
    return min(edges, _segment_distance(p, c, a))
