"""Clearances between robot, object and table with their gradients, compiled.

Every clearance is a lower bound of the true one: spheres cover the robot from outside. Rows come out for what is nearer
than an activation distance only, at most one for a body and obstacle, or a pair of bodies.
"""

from typing import NamedTuple

import numpy as np

from dexgrasp.geometry.convex_kernel import Obstacle, convex_distance
from dexgrasp.mechanics.kinematics.forward import Frames, add_row, body_frames, to_world
from dexgrasp.mechanics.kinematics.tree import RobotTree
from dexgrasp_env.arrays import Array, Index, Mask
from dexgrasp_env.compiled import leaf, njit

OBJECT, TABLE, SELF, NEIGHBOUR = 0, 1, 2, 3
ROUNDING = 1e-9  # m: two ways to compute a distance differ by less
KINDS = ("hand_object", "hand_table", "self", "hand_neighbour")


class Rows(NamedTuple):
    """Room for clearances and their gradients."""

    values: Array  # (K,) m
    gradients: Array  # (K, n) m/rad
    labels: Index  # (K, 3): kind, body, other body (-1 for all but the robot)


class Cover(NamedTuple):
    """A robot where it stands, and its covering spheres, world frame; those of a body once they are asked for."""

    tree: RobotTree
    frames: Frames  # of its bodies
    bounds: Array  # (nb, 3) m, centres of the spheres around whole bodies
    centres: Array  # (ns, 3) m
    known: Mask  # (nb,): whose centres are there
    room: Array  # (7, 3) to work in


def empty_rows(count: int, tree: RobotTree) -> Rows:
    """Return room for `count` clearances of a robot."""
    return Rows(np.empty(count), np.empty((count, len(tree.lower))), np.empty((count, 3), dtype=np.int64))


@njit
def clearance_rows(
    tree: RobotTree,
    frames: Frames,
    obstacles: tuple[Obstacle, Obstacle],
    activation: float,
    tips_touch: bool,
    rows: Rows,
) -> int:
    """Write clearances below `activation`, and their gradients; return how many.

    Args:
        tree: the robot.
        frames: of its bodies.
        obstacles: the object in the world frame, and what stands around it; `NOTHING` where there is none.
        activation: m.
        tips_touch: whether the grasping tips may touch the object; what stands around it they may not.
        rows: filled.
    """
    obstacle, around = obstacles
    n, with_object, cover = 0, obstacle.planes.shape[0] > 0, cover_of(tree, frames)
    in_company = around.planes.shape[0] > 0
    direction, up = np.empty(3), np.array([0.0, 0.0, 1.0])
    for b in range(2, tree.parent.shape[0]):
        if tree.bound_radius[b] < 0.0 or n >= rows.values.shape[0] - 3:
            continue
        best, which = activation, -1
        if cover.bounds[b, 2] - tree.bound_radius[b] <= activation:
            best, which = table_clearance(cover, b, activation)
        if which >= 0:
            _write(rows, n, best, (TABLE, b, -1), cover, cover.centres[which], up)
            n += 1
        if with_object:
            best, which = object_clearance(cover, b, obstacle, activation, tips_touch, direction)
            if which >= 0:
                _write(rows, n, best, (OBJECT, b, -1), cover, cover.centres[which], direction)
                n += 1
        if in_company:
            best, which = object_clearance(cover, b, around, activation, False, direction)
            if which >= 0:
                _write(rows, n, best, (NEIGHBOUR, b, -1), cover, cover.centres[which], direction)
                n += 1
    n = _palm_row(cover, activation, rows, n)
    return _self_rows(cover, activation, rows, n)


def clearances(
    q: Array, tree: RobotTree, obstacles: tuple[Obstacle, Obstacle], activation: float, tips_touch: bool
) -> tuple[Array, Index]:
    """Return the clearances (K,) m at `q` (n,) rad that `clearance_rows` finds, and their labels (K, 3)."""
    rows = empty_rows(256, tree)  # more than there are bodies and pairs of them
    n = clearance_rows(tree, body_frames(q, tree), obstacles, activation, tips_touch, rows)
    return rows.values[:n], rows.labels[:n]


@njit
def cover_of(tree: RobotTree, frames: Frames) -> Cover:
    """Return where the spheres around whole bodies are; the others wait to be asked for."""
    nb = tree.parent.shape[0]
    spheres = tree.sphere_radius.shape[0]
    known = np.zeros(nb, dtype=np.bool_)
    cover = Cover(tree, frames, np.empty((nb, 3)), np.empty((spheres, 3)), known, np.empty((7, 3)))
    for b in range(nb):
        to_world(frames.R[b], frames.p[b], tree.bound_centre[b], cover.bounds[b])
    return cover


@leaf
def _know(cover: Cover, b: int) -> None:
    tree, frames = cover.tree, cover.frames
    if not cover.known[b]:
        cover.known[b] = True
        for s in range(tree.sphere_first[b], tree.sphere_first[b + 1]):
            to_world(frames.R[b], frames.p[b], tree.sphere_centre[s], cover.centres[s])


@leaf
def table_clearance(cover: Cover, b: int, activation: float) -> tuple[float, int]:
    """Return the clearance of body `b` from the table and the sphere that has it; `activation` and -1 if beyond."""
    tree, centres, best, which = cover.tree, cover.centres, activation, -1
    _know(cover, b)
    for s in range(tree.sphere_first[b], tree.sphere_first[b + 1]):
        # m: nearer to the base than this the arm stands on its plinth, not over the table
        if centres[s, 0] < 0.15 and b < tree.base:
            continue
        d = centres[s, 2] - tree.sphere_radius[s]
        if d < best:
            best, which = d, s
    return best, which


@leaf
def object_clearance(
    cover: Cover, b: int, obstacle: Obstacle, activation: float, tips_touch: bool, direction: Array
) -> tuple[float, int]:
    """Return the clearance of body `b` from the object and the sphere that has it; `activation` and -1 if beyond.

    `direction` (3,) is written with its gradient by that sphere's centre.
    """
    tree, centres, best, which = cover.tree, cover.centres, activation, -1
    gradient, first = cover.room[0], cover.room[1]
    last = cover.bounds[b]
    middle = convex_distance(last, obstacle, first, activation + tree.bound_radius[b])
    at_last = middle
    if middle - tree.bound_radius[b] >= activation:
        return best, which
    _know(cover, b)
    convex, nearest = obstacle.starts.shape[0] == 2, -1
    if convex:
        nearest = _lowest(cover, b, first, tips_touch)
    for k in range(tree.sphere_first[b] - 1, tree.sphere_first[b + 1]):
        s = nearest if k < tree.sphere_first[b] else k  # it comes first: the others then need no query
        if s < 0 or k == nearest or (tips_touch and tree.sphere_is_tip[s]):
            continue
        centre, need = centres[s], best + tree.sphere_radius[s]
        if convex:
            # The distance to one convex body is a convex function: it lies above each of its tangents.
            if middle + _along(first, cover.bounds[b], centre) > need + ROUNDING:
                continue
            if which >= 0:
                at_best = best + tree.sphere_radius[which]
                if at_best + _along(direction, centres[which], centre) > need + ROUNDING:
                    continue
        # A distance changes by no more than the way between two points.
        elif middle - need > 0.0 and _squared(centre, cover.bounds[b]) < (middle - need) ** 2:
            continue
        if at_last - need > 0.0 and _squared(centre, last) < (at_last - need) ** 2:
            continue
        at_last, last = convex_distance(centre, obstacle, gradient, need), centre
        if at_last < need:
            best, which = at_last - tree.sphere_radius[s], s
            for r in range(3):
                direction[r] = gradient[r]
    return best, which


@leaf
def _lowest(cover: Cover, b: int, direction: Array, tips_touch: bool) -> int:
    """Return the sphere of body `b` that reaches farthest against a direction, -1 where none counts."""
    tree, least, which = cover.tree, np.inf, -1
    for s in range(tree.sphere_first[b], tree.sphere_first[b + 1]):
        if tips_touch and tree.sphere_is_tip[s]:
            continue
        low = _along(direction, cover.bounds[b], cover.centres[s]) - tree.sphere_radius[s]
        if low < least:
            least, which = low, s
    return which


@leaf
def bounds_clearance(cover: Cover, a: int, b: int) -> float:
    """Return the clearance between the spheres around two whole bodies, which is no more than that between them."""
    apart = np.sqrt(_squared(cover.bounds[a], cover.bounds[b]))
    return apart - cover.tree.bound_radius[a] - cover.tree.bound_radius[b]


@leaf
def self_clearance(cover: Cover, a: int, b: int, activation: float) -> tuple[float, int, int]:
    """Return the clearance between two bodies and the spheres that have it; `activation` and -1 if beyond."""
    tree, centres, best, first, second = cover.tree, cover.centres, activation, -1, -1
    _know(cover, a)
    _know(cover, b)
    for s in range(tree.sphere_first[a], tree.sphere_first[a + 1]):
        reach = tree.sphere_radius[s] + tree.bound_radius[b] + best
        if _squared(centres[s], cover.bounds[b]) > reach * reach:
            continue
        for t in range(tree.sphere_first[b], tree.sphere_first[b + 1]):
            together = tree.sphere_radius[s] + tree.sphere_radius[t]
            squared = _squared(centres[s], centres[t])
            if squared < (together + best) ** 2:
                best, first, second = np.sqrt(squared) - together, s, t
    return best, first, second


@leaf
def _write(
    rows: Rows,
    n: int,
    value: float,
    label: tuple[int, int, int],
    cover: Cover,
    point: Array,
    direction: Array,
) -> None:
    """Write row `n`, with the gradient of a point of the first body in a direction."""
    rows.values[n], rows.gradients[n] = value, 0.0
    rows.labels[n, 0], rows.labels[n, 1], rows.labels[n, 2] = label
    add_row(rows.gradients[n], label[1], point, direction, 1.0, cover.tree, cover.frames)


@leaf
def palm_clearance(cover: Cover, activation: float, nearest: Array, direction: Array) -> float:
    """Return the clearance of the link that works beside the palm from it, `activation` if beyond.

    It works closer to the palm than covering spheres can tell: points of its box's edges against the true box.
    `nearest` (3,) and `direction` (3,) are written with the point that has it and its gradient.
    """
    tree, frames, best = cover.tree, cover.frames, activation
    inside, point, local = cover.room[2], cover.room[3], cover.room[4]
    R, p, palm, beside, last, at_last = frames.R, frames.p, tree.palm, tree.beside, 0, -1.0
    for k in range(tree.beside_edges.shape[0]):
        # As in `object_clearance`: what lies near a point that is far enough away need not be looked at.
        room = at_last - best - ROUNDING
        if room > 0.0 and _squared(tree.beside_edges[k], tree.beside_edges[last]) < room * room:
            continue
        to_world(R[beside], p[beside], tree.beside_edges[k], point)
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
        # m: how much the points of an edge may miss between two of them
        d = (np.sqrt(squared) if squared > 0.0 else deepest) - 0.0005
        last, at_last = k, d
        if d >= best:
            continue
        best = d
        for r in range(3):
            nearest[r], direction[r] = point[r], 0.0
            for c in range(3):
                part = inside[c] / np.sqrt(squared) if squared > 0.0 else (1.0 if c == axis else 0.0)
                direction[r] += R[palm, r, c] * (part if local[c] > 0.0 else -part)
    return best


@leaf
def _palm_row(cover: Cover, activation: float, rows: Rows, n: int) -> int:
    tree, direction, nearest = cover.tree, cover.room[5], cover.room[6]
    best = palm_clearance(cover, activation, nearest, direction)
    if best >= activation:
        return n
    _write(rows, n, best, (SELF, tree.beside, tree.palm), cover, nearest, direction)
    add_row(rows.gradients[n], tree.palm, nearest, direction, -1.0, tree, cover.frames)
    return n + 1


@leaf
def _self_rows(cover: Cover, activation: float, rows: Rows, n: int) -> int:
    tree, centres, direction = cover.tree, cover.centres, cover.room[5]
    for k in range(tree.pairs.shape[0]):
        if n >= rows.values.shape[0]:
            continue
        a, b = tree.pairs[k, 0], tree.pairs[k, 1]
        reach = tree.bound_radius[a] + tree.bound_radius[b] + activation
        if _squared(cover.bounds[a], cover.bounds[b]) > reach * reach:
            continue
        best, first, second = self_clearance(cover, a, b, activation)
        if first >= 0:
            norm = np.sqrt(_squared(centres[first], centres[second])) + 1e-12
            for r in range(3):
                direction[r] = (centres[first, r] - centres[second, r]) / norm
            _write(rows, n, best, (SELF, a, b), cover, centres[first], direction)
            add_row(rows.gradients[n], b, centres[second], direction, -1.0, tree, cover.frames)
            n += 1
    return n


@leaf
def _along(direction: Array, a: Array, b: Array) -> float:
    """Return the distance from a to b along a direction."""
    return direction[0] * (b[0] - a[0]) + direction[1] * (b[1] - a[1]) + direction[2] * (b[2] - a[2])


@leaf
def _squared(a: Array, b: Array) -> float:
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
