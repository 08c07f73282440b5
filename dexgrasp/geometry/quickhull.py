"""The few points that tell most of a convex hull: Quickhull that adds the farthest point and stops early.

Barber, Dobkin and Huhdanpaa, The Quickhull algorithm for convex hulls (1996). It only chooses points: planes of thin
triangles are noise, and the hull of what it chose is better made by Qhull, which merges them.
"""

from typing import NamedTuple

import numpy as np

from dexgrasp.geometry.triangle import cross
from dexgrasp_env.arrays import Array, Index, Mask
from dexgrasp_env.compiled import njit

_JOGGLE = 1e-6  # m
_OUTSIDE = 1e-9  # m


class _Faces(NamedTuple):
    """Triangles of the hull of the points chosen so far; slots are used again."""

    corners: Index  # (F, 3) which of the points chosen, counter-clockwise seen from outside
    planes: Array  # (F, 4) outward unit normal and offset
    alive: Mask  # (F,)
    seen: Index  # (n, n): the last point that saw a face with the edge from one corner to another


def extreme_points(points: Array, count: int) -> Index:
    """Return up to `count` of points: three that span much, then always the one farthest outside the faces so far.

    Fewer where their hull holds all. For the choice the points are joggled, so that no four lie in a plane and no
    triangle is without one.

    Args:
        points: (N, 3) m, N >= 4.
        count: at least 4.
    """
    joggled = points + np.random.default_rng(0).uniform(-_JOGGLE, _JOGGLE, points.shape)
    first = joggled[:, 0].argmin()
    local = joggled - joggled[first]
    second = (local**2).sum(1).argmax()
    third = (np.cross(local, local[second]) ** 2).sum(1).argmax()
    return _extreme_points(joggled, np.array([first, second, third]), count)


@njit
def _extreme_points(points: Array, start: Index, count: int) -> Index:
    """Continue from the two sides of a triangle."""
    chosen, corners, n, size = np.empty(count, np.int64), np.empty((count, 3)), 3, 2 * count + 4
    chosen[:n], corners[:n] = start, points[start]
    faces = _Faces(
        np.empty((size, 3), np.int64), np.empty((size, 4)), np.zeros(size, np.bool_),
        np.full((count, count), -1),
    )  # fmt: skip
    _set_face(corners, faces, 0, 0, 1, 2)
    _set_face(corners, faces, 1, 0, 2, 1)
    height, face, new = np.empty(len(points)), np.full(len(points), -1), np.arange(2)
    while True:
        far = _farthest(points, faces, new, height, face)
        if n == count or height[far] <= _OUTSIDE:
            return chosen[:n]
        chosen[n], corners[n] = far, points[far]
        new = _add(corners, faces, n, face)
        n += 1
        if not len(new):
            return chosen[:n]


@njit
def _height(plane: Array, p: Array) -> float:
    return plane[0] * p[0] + plane[1] * p[1] + plane[2] * p[2] + plane[3]


@njit
def _set_face(corners: Array, faces: _Faces, slot: int, a: int, b: int, c: int) -> None:
    faces.corners[slot, 0], faces.corners[slot, 1], faces.corners[slot, 2] = a, b, c
    plane = faces.planes[slot]
    cross(corners[b] - corners[a], corners[c] - corners[a], plane)
    size = np.sqrt(plane[0] ** 2 + plane[1] ** 2 + plane[2] ** 2)
    for k in range(3):
        # m2: twice the area of a triangle without a plane of its own
        plane[k] = plane[k] / size if size > 1e-12 else 0.0  # without a plane: no point is outside
    plane[3] = 0.0
    plane[3] = -_height(plane, corners[a])
    faces.alive[slot] = True


@njit
def _farthest(points: Array, faces: _Faces, new: Index, height: Array, face: Index) -> int:
    """Update how far the points are outside (N,) m, and of which face, by new faces; return the farthest.

    What saw a face that is gone and sees none of the new ones is inside for good; its `face` is -1 before.
    """
    far = 0
    for k in range(len(points)):
        if face[k] < 0:
            height[k] = -np.inf
        for f in new:
            up = _height(faces.planes[f], points[k])
            if up > height[k]:
                height[k], face[k] = up, f
        if height[k] > height[far]:
            far = k
    return far


@njit
def _add(corners: Array, faces: _Faces, n: int, face: Index) -> Index:
    """Put a cone to corner `n` in place of the faces that it sees; return the new faces.

    Points whose `face` (N,) is gone get -1. There are none where rounding makes the faces seen no disc.
    """
    gone = np.empty(len(faces.alive), np.int64)
    m = 0
    for f in range(len(faces.alive)):
        if faces.alive[f] and _height(faces.planes[f], corners[n]) > _OUTSIDE:
            gone[m] = f
            m += 1
            for k in range(3):
                faces.seen[faces.corners[f, k], faces.corners[f, (k + 1) % 3]] = n
    edges, e = np.empty((3 * m, 2), np.int64), 0
    for f in gone[:m]:
        for k in range(3):
            a, b = faces.corners[f, k], faces.corners[f, (k + 1) % 3]
            if faces.seen[b, a] != n:
                edges[e, 0], edges[e, 1] = a, b
                e += 1
        faces.alive[f] = False
    if e > m + 2:
        return edges[:0, 0]
    for k in range(len(face)):
        if not faces.alive[face[k]]:
            face[k] = -1
    new, slot = np.empty(e, np.int64), 0
    for k in range(e):
        while faces.alive[slot]:
            slot += 1
        _set_face(corners, faces, slot, edges[k, 0], edges[k, 1], n)
        new[k] = slot
    return new
