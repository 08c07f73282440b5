"""Exact signed distance to a union of convex polyhedra, with gradient, closest point and Hessian.

Outside, the distance to the union is the least of those to its parts. Inside, the least is a lower bound: where parts
overlap, the surface is farther away than that.

The functions are compiled and may be called from compiled code. Source: Eq. (3).
"""

import math
from typing import NamedTuple

import numpy as np

from dexgrasp.geometry.triangle import EDGE, FACE, VERTEX, closest_on_triangle
from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.compiled import leaf, njit


class Obstacle(NamedTuple):
    """A union of convex polyhedra; one without faces stands for no obstacle."""

    triangles: Array  # (F, 3, 3) corners, counter-clockwise seen from outside, m
    planes: Array  # (F, 4) outward unit normal and offset of each triangle: n . x + offset <= 0 inside
    starts: Index  # (P + 1,) first face of each part, and the number of faces


@leaf
def _farthest_plane(
    px: float, py: float, pz: float, planes: Array, first: int, end: int, limit: float
) -> tuple[float, int]:
    """Return the largest plane value of a part, a lower bound of its distance, and its face; from `limit` on any."""
    best, face = -math.inf, first
    for j in range(first, end):
        value = planes[j, 0] * px + planes[j, 1] * py + planes[j, 2] * pz + planes[j, 3]
        if value > best:
            best, face = value, j
            if best >= limit:
                break
    return best, face


@leaf
def _walk(
    px: float, py: float, pz: float, obstacle: Obstacle, first: int, end: int, start: int
) -> tuple[float, float, float, float, int, int]:
    """Descend from a face of a part that p sees to its closest point; return squared distance, point, code, face.

    The distance to a convex body has no local minimum on the faces that p sees but the global one, so it is
    enough to try the seen faces that hold the present point. When a whole round brings no gain, the point
    is the closest.
    """
    triangles, planes = obstacle.triangles, obstacle.planes
    face, count = start, end - first
    cx, cy, cz, code = closest_on_triangle(px, py, pz, triangles[start])
    best = (px - cx) ** 2 + (py - cy) ** 2 + (pz - cz) ** 2
    j, idle = start, 0
    while code != 0 and idle < count:
        j = j + 1 if j + 1 < end else first
        idle += 1
        nx, ny, nz, offset = planes[j, 0], planes[j, 1], planes[j, 2], planes[j, 3]
        # A face within this of a point [m] counts as holding it; far below any feature size, far above rounding.
        if nx * cx + ny * cy + nz * cz + offset < -1e-9 or nx * px + ny * py + nz * pz + offset <= 0.0:
            continue
        x, y, z, trial = closest_on_triangle(px, py, pz, triangles[j])
        squared = (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2
        if squared < best * (1.0 - 1e-13):
            best, face, idle = squared, j, 0
            cx, cy, cz, code = x, y, z, trial
    return best, cx, cy, cz, code, face


@leaf
def closest_feature(
    p: Array, obstacle: Obstacle, gradient_out: Array, limit: float
) -> tuple[float, int, int]:
    """Return the signed distance, the closest feature's code and a face that holds it.

    Args:
        p: (3,) point [m].
        obstacle: the polyhedra.
        gradient_out: (3,) receives the unit gradient: the face's normal inside, (p - closest) / distance outside.
        limit: from here on [m] any lower bound of the distance that is no less will do, without a gradient.

    Returns:
        Signed distance [m] (negative inside), feature code (see `triangle.VERTEX`), face index.
    """
    px, py, pz, planes = p[0], p[1], p[2], obstacle.planes
    distance, beyond, code, face = math.inf, math.inf, 0, 0
    for part in range(obstacle.starts.shape[0] - 1):
        first, end = obstacle.starts[part], obstacle.starts[part + 1]
        enough = min(distance, limit)
        bound, seen = _farthest_plane(px, py, pz, planes, first, end, enough)
        if bound >= enough:
            beyond = min(beyond, bound)
            continue
        if bound > 0.0:
            squared, x, y, z, walked, holder = _walk(px, py, pz, obstacle, first, end, seen)
            reached = math.sqrt(squared)
            # A point over an edge between coplanar triangles is over their face, where the plane itself is exact.
            if walked != 0 and reached - bound > 1e-12 * reached + 1e-15:
                if reached < distance:
                    distance, code, face = reached, walked, holder
                    gradient_out[0] = (px - x) / reached
                    gradient_out[1] = (py - y) / reached
                    gradient_out[2] = (pz - z) / reached
                continue
        distance, code, face = bound, 0, seen
        gradient_out[0], gradient_out[1], gradient_out[2] = planes[seen, 0], planes[seen, 1], planes[seen, 2]
    return min(distance, beyond), code, face


@leaf
def convex_distance(p: Array, obstacle: Obstacle, gradient_out: Array, limit: float = math.inf) -> float:
    """Return the exact signed distance [m] of p (3,) and write its unit gradient (3,); see `closest_feature`.

    Outside one polyhedron the gradient is continuous: the normal of the polyhedron rounded by the distance. Inside it
    is the normal of the nearest face.
    """
    return closest_feature(p, obstacle, gradient_out, limit)[0]


@njit
def convex_distance_hessian(p: Array, obstacle: Obstacle, gradient_out: Array, hessian_out: Array) -> float:
    """Return the signed distance [m] and write its gradient (3,) and exact Hessian (3, 3) [1/m].

    With n the gradient, d the distance and t the direction of the closest edge, the Hessian is 0 over faces
    and inside, (I - n n' - t t') / d over edges and (I - n n') / d over vertices.
    """
    distance, code, face = closest_feature(p, obstacle, gradient_out, math.inf)
    hessian_out[:] = 0.0
    if code == FACE:
        return distance
    hessian_out[:] = (np.eye(3) - np.outer(gradient_out, gradient_out)) / distance
    if code < VERTEX:
        edge = obstacle.triangles[face, code % 3] - obstacle.triangles[face, code - EDGE]
        scale = 1.0 / ((edge[0] ** 2 + edge[1] ** 2 + edge[2] ** 2) * distance)
        hessian_out -= np.outer(edge, edge) * scale
    return distance


@njit
def convex_distances(points: Array, obstacle: Obstacle, gradients_out: Array) -> Array:
    """Return the signed distances (N,) [m] of points (N, 3) and write their gradients (N, 3)."""
    distances = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        distances[i] = convex_distance(points[i], obstacle, gradients_out[i], math.inf)
    return distances
