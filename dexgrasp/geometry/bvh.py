"""A tree of boxes over triangles, and the nearest triangle to a point."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dexgrasp.geometry.triangle import closest_on_triangle

LEAF = 4
"""Most triangles in a leaf."""
DEPTH = 64
"""Size of the traversal's stack; halving trees of 2^32 triangles need 32."""


class Tree(NamedTuple):
    """Boxes over triangles that are stored in the tree's order.

    Attributes:
        triangles: (F, 3, 3) corners [m] in the tree's order.
        boxes: (M, 6) least and greatest corner of each node [m].
        nodes: (M, 2) int64: (left child, 0), the right child following the left; or (first triangle, count).
        faces: (F,) int64, the mesh's index of each triangle.
    """

    triangles: NDArray[Any]
    boxes: NDArray[Any]
    nodes: NDArray[Any]
    faces: NDArray[Any]


def build_tree(triangles: NDArray[Any]) -> Tree:
    """Return the tree over triangles (F, 3, 3), halved where their centres spread most."""
    triangles = np.ascontiguousarray(triangles, dtype=np.float64)
    boxes, nodes, faces = _split(triangles)
    return Tree(triangles[faces], boxes, nodes, faces)


@njit(cache=True)
def _split(triangles: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return boxes, nodes and the order of the triangles."""
    count = triangles.shape[0]
    order = np.arange(count)
    boxes = np.empty((2 * count, 6))
    nodes = np.zeros((2 * count, 2), np.int64)
    ranges = np.zeros((2 * count, 2), np.int64)
    ranges[0, 1] = count
    used, node = 1, 0
    while node < used:
        first, last = ranges[node]
        axis = _bound(triangles, order[first:last], boxes[node])
        if last - first <= LEAF:
            nodes[node, 0], nodes[node, 1] = first, last - first
        else:
            part = order[first:last]
            centres = triangles[part, 0, axis] + triangles[part, 1, axis] + triangles[part, 2, axis]
            order[first:last] = part[np.argsort(centres, kind="mergesort")]
            middle = (first + last) // 2
            nodes[node, 0] = used
            ranges[used, 0], ranges[used, 1] = first, middle
            ranges[used + 1, 0], ranges[used + 1, 1] = middle, last
            used += 2
        node += 1
    return boxes[:used].copy(), nodes[:used].copy(), order


@njit(cache=True)
def _bound(triangles: NDArray[Any], part: NDArray[Any], box_out: NDArray[Any]) -> int:
    """Write the box of some triangles and return the axis along which their centres spread most."""
    axis, widest = 0, -1.0
    for k in range(3):
        least, greatest, low, high = math.inf, -math.inf, math.inf, -math.inf
        for f in part:
            a, b, c = triangles[f, 0, k], triangles[f, 1, k], triangles[f, 2, k]
            least, greatest = min(least, a, b, c), max(greatest, a, b, c)
            low, high = min(low, a + b + c), max(high, a + b + c)
        box_out[k], box_out[k + 3] = least, greatest
        if high - low > widest:
            axis, widest = k, high - low
    return axis


@njit(cache=True, error_model="numpy")
def _squared_to_box(px: float, py: float, pz: float, box: NDArray[Any]) -> float:
    """Return the squared distance of p to a box, 0 inside."""
    x = max(box[0] - px, 0.0, px - box[3])
    y = max(box[1] - py, 0.0, py - box[4])
    z = max(box[2] - pz, 0.0, pz - box[5])
    return x * x + y * y + z * z


@njit(cache=True, error_model="numpy")
def nearest_triangle(
    px: float,
    py: float,
    pz: float,
    triangles: NDArray[Any],
    boxes: NDArray[Any],
    nodes: NDArray[Any],
    guess: int,
) -> tuple[float, float, float, float, int, int]:
    """Return the squared distance, closest point, feature code and index (in the tree's order) of the
    nearest triangle.

    Args:
        px, py, pz: the point [m].
        triangles, boxes, nodes: see `Tree`.
        guess: a triangle (in the tree's order) that may be near: the better the guess, the less is searched.
    """
    cx, cy, cz, code = closest_on_triangle(px, py, pz, triangles[guess])
    best, face = (px - cx) ** 2 + (py - cy) ** 2 + (pz - cz) ** 2, guess
    if not best < math.inf:  # a triangle without area can yield NaN
        best = math.inf
    stack, bounds = np.empty(DEPTH, np.int64), np.empty(DEPTH)
    stack[0], bounds[0], size = 0, 0.0, 1
    while size > 0:
        size -= 1
        if bounds[size] >= best:
            continue
        child, count = nodes[stack[size], 0], nodes[stack[size], 1]
        if count == 0:
            left = _squared_to_box(px, py, pz, boxes[child])
            right = _squared_to_box(px, py, pz, boxes[child + 1])
            near = child if left <= right else child + 1
            stack[size], bounds[size] = 2 * child + 1 - near, max(left, right)
            stack[size + 1], bounds[size + 1] = near, min(left, right)
            size += 2
            continue
        for f in range(child, child + count):
            x, y, z, trial = closest_on_triangle(px, py, pz, triangles[f])
            squared = (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2
            if squared < best:
                best, face = squared, f
                cx, cy, cz, code = x, y, z, trial
    return best, cx, cy, cz, code, face
