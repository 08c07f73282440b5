"""Clearances between robot, object and table with their gradients, compiled.

Every clearance is a lower bound of the true one: spheres cover the robot from outside. Rows come out for what is nearer
than an activation distance only, at most one for a body and obstacle, or a pair of bodies.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from agents.geometry.convex_kernel import Obstacle, convex_distance
from agents.kinematics.forward import Frames, add_row, to_world
from agents.kinematics.tree import RobotTree
from dexgrasp_env.arrays import Array

OBJECT, TABLE, SELF = 0, 1, 2
EDGE_ERROR = 0.0005  # m: how much the points of an edge may miss between two of them
KINDS = ("hand_object", "hand_table", "self")
TABLE_FROM = 0.15  # m: nearer to the base than this the arm stands on its plinth, not over the table


class Rows(NamedTuple):
    """Room for clearances and their gradients."""

    values: Array  # (K,) m
    gradients: Array  # (K, 23) m/rad
    labels: NDArray[np.int64]  # (K, 3): kind, body, other body (-1 for object and table)


class Cover(NamedTuple):
    """Where the covering spheres are, robot base frame."""

    bounds: Array  # (nb, 3) m, centres of the spheres around whole bodies
    centres: Array  # (ns, 3) m


@njit(cache=True, error_model="numpy")
def empty_rows(count: int) -> Rows:
    """Return room for `count` clearances."""
    return Rows(np.empty(count), np.empty((count, 23)), np.empty((count, 3), dtype=np.int64))


@njit(cache=True, error_model="numpy")
def clearance_rows(
    tree: RobotTree, frames: Frames, obstacle: Obstacle, activation: float, tips_touch: bool, rows: Rows
) -> int:
    """Write clearances below `activation`, and their gradients; return how many.

    Args:
        tree: the robot.
        frames: of its bodies.
        obstacle: the object in the robot base frame, `NOTHING` where there is none.
        activation: m.
        tips_touch: whether the grasping tips may touch the object.
        rows: filled.
    """
    n, with_object, cover = 0, obstacle.planes.shape[0] > 0, _cover(tree, frames)
    bounds, centres = cover.bounds, cover.centres
    gradient, best_gradient = np.empty(3), np.empty(3)
    for b in range(2, tree.parent.shape[0]):
        if tree.bound_radius[b] < 0.0 or n >= rows.values.shape[0] - 2:
            continue
        n = _table_row(tree, frames, cover, b, activation, rows, n)
        if not with_object:
            continue
        middle = convex_distance(bounds[b], obstacle, gradient)
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
            at_last, last = convex_distance(centres[s], obstacle, gradient), centres[s]
            d = at_last - tree.sphere_radius[s]
            if d < best:
                best, which = d, s
                best_gradient[:] = gradient
        if which >= 0:
            _start(rows, n, best, OBJECT, b, -1)
            add_row(rows.gradients[n], b, centres[which], best_gradient, 1.0, tree, frames)
            n += 1
    n = _palm_row(tree, frames, activation, rows, n)
    return _self_rows(tree, frames, cover, activation, rows, n)


@njit(cache=True, error_model="numpy")
def _cover(tree: RobotTree, frames: Frames) -> Cover:
    nb, R, p = tree.parent.shape[0], frames.R, frames.p
    cover = Cover(np.empty((nb, 3)), np.empty((tree.sphere_radius.shape[0], 3)))
    for b in range(nb):
        to_world(R[b], p[b], tree.bound_centre[b], cover.bounds[b])
        for s in range(tree.sphere_first[b], tree.sphere_first[b + 1]):
            to_world(R[b], p[b], tree.sphere_centre[s], cover.centres[s])
    return cover


@njit(cache=True, error_model="numpy")
def _start(rows: Rows, n: int, value: float, kind: int, body: int, other: int) -> None:
    """Begin row `n` with a gradient of nothing."""
    rows.values[n], rows.gradients[n] = value, 0.0
    rows.labels[n, 0], rows.labels[n, 1], rows.labels[n, 2] = kind, body, other


@njit(cache=True, error_model="numpy")
def _palm_row(tree: RobotTree, frames: Frames, activation: float, rows: Rows, n: int) -> int:
    """The thumb's medial link beside the palm: closer than covering spheres can tell, so edges against the true box."""
    best, inside = activation, np.zeros(3)
    point, local, direction, nearest = np.empty(3), np.empty(3), np.zeros(3), np.zeros(3)
    R, p, palm, thumb = frames.R, frames.p, tree.palm, tree.thumb
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
        d = (np.sqrt(squared) if squared > 0.0 else deepest) - EDGE_ERROR
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
    _start(rows, n, best, SELF, thumb, palm)
    add_row(rows.gradients[n], thumb, nearest, direction, 1.0, tree, frames)
    add_row(rows.gradients[n], palm, nearest, direction, -1.0, tree, frames)
    return n + 1


@njit(cache=True, error_model="numpy")
def _table_row(
    tree: RobotTree, frames: Frames, cover: Cover, b: int, activation: float, rows: Rows, n: int
) -> int:
    centres = cover.centres
    if cover.bounds[b, 2] - tree.bound_radius[b] > activation:
        return n
    best, which = activation, -1
    for s in range(tree.sphere_first[b], tree.sphere_first[b + 1]):
        if centres[s, 0] < TABLE_FROM and b < 4:
            continue
        d = centres[s, 2] - tree.sphere_radius[s]
        if d < best:
            best, which = d, s
    if which < 0:
        return n
    _start(rows, n, best, TABLE, b, -1)
    add_row(rows.gradients[n], b, centres[which], np.array([0.0, 0.0, 1.0]), 1.0, tree, frames)
    return n + 1


@njit(cache=True, error_model="numpy")
def _self_rows(tree: RobotTree, frames: Frames, cover: Cover, activation: float, rows: Rows, n: int) -> int:
    bounds, centres, direction = cover.bounds, cover.centres, np.empty(3)
    for k in range(tree.pairs.shape[0]):
        a, b = tree.pairs[k, 0], tree.pairs[k, 1]
        reach = tree.bound_radius[a] + tree.bound_radius[b] + activation
        if _squared(bounds[a], bounds[b]) > reach * reach or n >= rows.values.shape[0]:
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
            _start(rows, n, best, SELF, a, b)
            add_row(rows.gradients[n], a, centres[first], direction, 1.0, tree, frames)
            add_row(rows.gradients[n], b, centres[second], direction, -1.0, tree, frames)
            n += 1
    return n


@njit(cache=True, error_model="numpy")
def _squared(a: Array, b: Array) -> float:
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
