"""The few points that tell most of a convex hull: Quickhull that adds the farthest point and stops early.

Barber, Dobkin and Huhdanpaa, The Quickhull algorithm for convex hulls (1996). It only chooses points: planes of thin
triangles are noise, and the hull of what it chose is better made by Qhull, which merges them.
"""

import numpy as np

from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.compiled import njit

_JOGGLE = 1e-6  # m
_OUTSIDE = 1e-9  # m


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
    """Continue from the two sides of a triangle; each point that is added becomes the tip of a cone of faces."""
    x, y, z = points[:, 0], points[:, 1], points[:, 2]
    chosen, size = np.empty(count, np.int64), 2 * count
    chosen[:3] = start
    # faces: which of the points chosen, counter-clockwise seen from outside; outward unit normal and offset
    corners, planes, alive = np.zeros((size, 3), np.int64), np.zeros((size, 4)), np.zeros(size, np.bool_)
    # Of each point over the face that sees it.
    height, face = np.full(len(points), -np.inf), np.zeros(len(points), np.int64)
    tip, begins, ends = 2, np.array([0, 1]), np.array([1, 0])
    while True:
        free = np.flatnonzero(~alive)
        for k in range(len(begins)):
            slot, a, b = free[k], begins[k], ends[k]
            corners[slot], alive[slot] = (a, b, tip), True
            p = planes[slot] = _plane(points[chosen[a]], points[chosen[b]], points[chosen[tip]])
            for i in range(len(points)):
                up = p[0] * x[i] + p[1] * y[i] + p[2] * z[i] + p[3]
                if up > height[i]:
                    height[i], face[i] = up, slot
        tip += 1
        far = height.argmax()
        if tip == count or height[far] <= _OUTSIDE:
            return chosen[:tip]
        chosen[tip] = far
        over = planes[:, 0] * x[far] + planes[:, 1] * y[far] + planes[:, 2] * z[far] + planes[:, 3]
        gone, seen = np.flatnonzero(alive & (over > _OUTSIDE)), np.zeros((count, count), np.bool_)
        for f in gone:
            for k in range(3):
                seen[corners[f, k], corners[f, k - 2]] = True
        begins, ends = np.nonzero(seen & ~seen.T)
        if len(begins) > len(gone) + 2:  # by rounding the faces seen are no disc
            return chosen[: tip + 1]
        # What saw a face that is gone and sees none of the new ones is inside for good.
        alive[gone] = False
        height = np.where(alive[face], height, -np.inf)


@njit
def _plane(a: Array, b: Array, c: Array) -> Array:
    """Return the unit normal and the offset (4,) of the plane through three points; zeros where they have none."""
    normal = np.cross(b - a, c - a)
    size = np.sqrt((normal**2).sum())
    if size <= 1e-12:  # m2: twice the area of a triangle without a plane of its own
        return np.zeros(4)
    return np.append(normal, -(normal * a).sum()) / size
