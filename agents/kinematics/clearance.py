"""Clearances between robot, object and table with their gradients, compiled.

Every clearance is a lower bound of the true one: spheres cover the robot from outside. Rows come out for what is nearer
than an activation distance only, at most one for a body and obstacle, or a pair of bodies.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from agents.geometry.convex_kernel import convex_distance
from agents.kinematics.forward import add_row, to_world
from agents.kinematics.tree import RobotTree
from dexgrasp_env.arrays import Array

OBJECT, TABLE, SELF = 0, 1, 2
_EDGE_ERROR = 0.0005  # m: how much the points of an edge may miss between two of them
KINDS = ("hand_object", "hand_table", "self")
_TABLE_FROM = 0.15  # m: nearer to the base than this the arm stands on its plinth, not over the table


@njit(cache=True, error_model="numpy")
def clearance_rows(
    tree: RobotTree,
    R: Array,
    p: Array,
    triangles: Array,
    planes: Array,
    activation: float,
    with_object: bool,
    tips_touch: bool,
    values: Array,
    rows: Array,
    labels: NDArray[np.int64],
) -> int:
    """Write clearances below `activation`, and their gradients; return how many.

    Args:
        tree: the robot.
        R: (nb, 3, 3) and
        p: (nb, 3) m, body frames from `forward`.
        triangles: (F, 3, 3) and
        planes: (F, 4), the convex object in the robot base frame.
        activation: m.
        with_object: whether the object counts.
        tips_touch: whether the grasping tips may touch the object.
        values: (K,) filled with clearances, m.
        rows: (K, 23) filled with gradients, m/rad.
        labels: (K, 3) filled with kind, body, other body (-1 for object and table).
    """
    n = 0
    nb = tree.parent.shape[0]
    centres = np.empty((tree.sphere_radius.shape[0], 3))
    bounds = np.empty((nb, 3))
    for b in range(nb):
        to_world(R[b], p[b], tree.bound_centre[b], bounds[b])
        for s in range(tree.sphere_first[b], tree.sphere_first[b + 1]):
            to_world(R[b], p[b], tree.sphere_centre[s], centres[s])
    gradient, best_gradient, up = np.empty(3), np.empty(3), np.array([0.0, 0.0, 1.0])
    for b in range(2, nb):
        if tree.bound_radius[b] < 0.0 or n >= values.shape[0] - 2:
            continue
        n = _table_row(tree, R, p, b, bounds, centres, activation, up, values, rows, labels, n)
        if not with_object:
            continue
        middle = convex_distance(bounds[b], triangles, planes, gradient)
        if middle - tree.bound_radius[b] > activation:
            continue
        best, which, last, at_last = activation, -1, bounds[b], middle
        for s in range(tree.sphere_first[b], tree.sphere_first[b + 1]):
            if tips_touch and tree.sphere_is_tip[s]:
                continue
            # A distance changes by no more than the way between two points: most spheres need no query.
            need = best + tree.sphere_radius[s]
            if middle - need > 0.0 and _squared(centres[s], bounds[b]) < (middle - need) ** 2:
                continue
            if at_last - need > 0.0 and _squared(centres[s], last) < (at_last - need) ** 2:
                continue
            at_last, last = convex_distance(centres[s], triangles, planes, gradient), centres[s]
            d = at_last - tree.sphere_radius[s]
            if d < best:
                best, which = d, s
                best_gradient[:] = gradient
        if which >= 0:
            rows[n] = 0.0
            add_row(rows[n], b, centres[which], best_gradient, 1.0, tree, R, p)
            values[n], labels[n, 0], labels[n, 1], labels[n, 2] = best, OBJECT, b, -1
            n += 1
    n = _palm_row(tree, R, p, activation, values, rows, labels, n)
    return _self_rows(tree, R, p, bounds, centres, activation, values, rows, labels, n)


@njit(cache=True, error_model="numpy")
def _palm_row(
    tree: RobotTree,
    R: Array,
    p: Array,
    activation: float,
    values: Array,
    rows: Array,
    labels: NDArray[np.int64],
    n: int,
) -> int:
    """The thumb's medial link beside the palm: closer than covering spheres can tell, so edges against the true box."""
    best, inside = activation, np.zeros(3)
    point, local, direction, nearest = np.empty(3), np.empty(3), np.zeros(3), np.zeros(3)
    palm, thumb = tree.palm, tree.thumb
    for k in range(tree.thumb_edges.shape[0]):
        to_world(R[thumb], p[thumb], tree.thumb_edges[k], point)
        squared, deepest, axis = 0.0, -1e9, 0
        for c in range(3):
            local[c] = -tree.palm_box_centre[c]
            for r in range(3):
                local[c] += R[palm, r, c] * (point[r] - p[palm, r])
            out = abs(local[c]) - tree.palm_box_half[c]
            if out > deepest:
                deepest, axis = out, c
            inside[c] = max(out, 0.0)
            squared += inside[c] ** 2
        d = (np.sqrt(squared) if squared > 0.0 else deepest) - _EDGE_ERROR
        if d >= best:
            continue
        best = d
        nearest[:] = point
        for r in range(3):
            direction[r] = 0.0
            for c in range(3):
                part = inside[c] / np.sqrt(squared) if squared > 0.0 else (1.0 if c == axis else 0.0)
                direction[r] += R[palm, r, c] * (part if local[c] > 0.0 else -part)
    if best >= activation:
        return n
    rows[n] = 0.0
    add_row(rows[n], thumb, nearest, direction, 1.0, tree, R, p)
    add_row(rows[n], palm, nearest, direction, -1.0, tree, R, p)
    values[n], labels[n, 0], labels[n, 1], labels[n, 2] = best, SELF, thumb, palm
    return n + 1


@njit(cache=True, error_model="numpy")
def _table_row(
    tree: RobotTree, R: Array, p: Array, b: int, bounds: Array, centres: Array, activation: float, up: Array,
    values: Array, rows: Array, labels: NDArray[np.int64], n: int,
) -> int:  # fmt: skip
    if bounds[b, 2] - tree.bound_radius[b] > activation:
        return n
    best, which = activation, -1
    for s in range(tree.sphere_first[b], tree.sphere_first[b + 1]):
        if centres[s, 0] < _TABLE_FROM and b < 4:
            continue
        d = centres[s, 2] - tree.sphere_radius[s]
        if d < best:
            best, which = d, s
    if which < 0:
        return n
    rows[n] = 0.0
    add_row(rows[n], b, centres[which], up, 1.0, tree, R, p)
    values[n], labels[n, 0], labels[n, 1], labels[n, 2] = best, TABLE, b, -1
    return n + 1


@njit(cache=True, error_model="numpy")
def _self_rows(
    tree: RobotTree, R: Array, p: Array, bounds: Array, centres: Array, activation: float,
    values: Array, rows: Array, labels: NDArray[np.int64], n: int,
) -> int:  # fmt: skip
    direction = np.empty(3)
    for k in range(tree.pairs.shape[0]):
        a, b = tree.pairs[k, 0], tree.pairs[k, 1]
        reach = tree.bound_radius[a] + tree.bound_radius[b] + activation
        if _squared(bounds[a], bounds[b]) > reach * reach or n >= values.shape[0]:
            continue
        best, first, second = activation, -1, -1
        for s in range(tree.sphere_first[a], tree.sphere_first[a + 1]):
            reach = tree.sphere_radius[s] + tree.bound_radius[b] + best
            if _squared(centres[s], bounds[b]) > reach * reach:
                continue
            for t in range(tree.sphere_first[b], tree.sphere_first[b + 1]):
                together = tree.sphere_radius[s] + tree.sphere_radius[t]
                squared = _squared(centres[s], centres[t])
                if squared < (together + best) ** 2:
                    best, first, second = np.sqrt(squared) - together, s, t
        if first >= 0:
            norm = np.sqrt(_squared(centres[first], centres[second])) + 1e-12
            for r in range(3):
                direction[r] = (centres[first, r] - centres[second, r]) / norm
            rows[n] = 0.0
            add_row(rows[n], a, centres[first], direction, 1.0, tree, R, p)
            add_row(rows[n], b, centres[second], direction, -1.0, tree, R, p)
            values[n], labels[n, 0], labels[n, 1], labels[n, 2] = best, SELF, a, b
            n += 1
    return n


@njit(cache=True, error_model="numpy")
def _squared(a: Array, b: Array) -> float:
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
