"""Clearances between robot, object and table with their gradients, compiled.

They are MuJoCo's distances of the true shapes, less than 0 where they overlap. Rows come out for what is nearer than an
activation distance only, at most one for a body and obstacle, or a pair of bodies.
"""

from typing import NamedTuple

import numpy as np

from dexgrasp.mechanics.kinematics.forward import Frames, add_row, body_frames, to_world
from dexgrasp.mechanics.kinematics.geom_distance import geom_distance
from dexgrasp.mechanics.kinematics.tree import RobotTree
from dexgrasp.mechanics.kinematics.world import World
from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.compiled import leaf, njit

OBJECT, TABLE, SELF, NEIGHBOUR = 0, 1, 2, 3
KINDS = ("hand_object", "hand_table", "self", "hand_neighbour")


class Rows(NamedTuple):
    """Room for clearances and their gradients."""

    values: Array  # (K,) m
    gradients: Array  # (K, n) m/rad
    labels: Index  # (K, 3): kind, body, other body (-1 for all but the robot)


def room_for_all(tree: RobotTree) -> Rows:
    """Return room for more clearances than there are bodies and pairs of them."""
    return empty_rows(256, tree)


def empty_rows(count: int, tree: RobotTree) -> Rows:
    """Return room for `count` clearances of a robot."""
    return Rows(np.empty(count), np.empty((count, len(tree.lower))), np.empty((count, 3), dtype=np.int64))


@njit
def clearance_rows(
    tree: RobotTree, frames: Frames, world: World, activation: float, tips_touch: bool, rows: Rows
) -> int:
    """Write clearances below `activation`, and their gradients; return how many.

    Args:
        tree: the robot.
        frames: of its bodies.
        world: its shapes, and what is around it.
        activation: m.
        tips_touch: whether the grasping tips may touch the object; what stands around it they may not.
        rows: filled.
    """
    n, most, parts, ends = 0, rows.values.shape[0], world.part.shape[0], np.empty((3, 6))
    place(world, frames)
    for b in range(2, tree.parent.shape[0]):
        if n >= most - 3:
            break
        value = table_clearance(world, b, activation, False, ends)
        if value < activation:
            n = _write(rows, n, value, (TABLE, b, -1), ends, tree, frames)
        value = part_clearance(world, b, 0, world.objects, activation, tips_touch, ends)
        if value < activation:
            n = _write(rows, n, value, (OBJECT, b, -1), ends, tree, frames)
        value = part_clearance(world, b, world.objects, parts, activation, False, ends)
        if value < activation:
            n = _write(rows, n, value, (NEIGHBOUR, b, -1), ends, tree, frames)
    for k in range(tree.pairs.shape[0]):
        a, b = tree.pairs[k, 0], tree.pairs[k, 1]
        value = self_clearance(world, a, b, activation, ends) if n < most else activation
        if value < activation:
            n = _write(rows, n, value, (SELF, a, b), ends, tree, frames)
    return n


@njit
def surface_rows(
    surface: tuple[Array, Array], bodies: Index, least: tuple[float, float], tree: RobotTree, frames: Frames,
    world: World, rows: Rows,
) -> int:  # fmt: skip
    """Write by how much bodies (B,) are farther than they may be from a surface, with gradients; return how many.

    Args:
        surface: groups of points (G, N, 3) m, and the middle and radius (G, 4) m of a sphere around each.
        bodies: of the robot.
        least: m that shapes of grasping tips, and others, are to be from it.
        tree, frames, world, rows: as in `clearance_rows`; their kind is one more than `KINDS` has.
    """
    n, far, ends = 0, 0.01, np.empty((3, 6))
    place(world, frames)
    for b in bodies:
        value, off = surface_clearance(surface, least, world, b, far, ends)
        if value < far:
            n = _write(rows, n, value + off, (len(KINDS), b, -1), ends, tree, frames)
            rows.values[n - 1] = value
    return n


def clearances(
    q: Array, tree: RobotTree, world: World, activation: float, tips_touch: bool
) -> tuple[Array, Index]:
    """Return the clearances (K,) m at `q` (n,) rad that `clearance_rows` finds, and their labels (K, 3)."""
    rows = room_for_all(tree)
    n = clearance_rows(tree, body_frames(q, tree), world, activation, tips_touch, rows)
    return rows.values[:n], rows.labels[:n]


@leaf
def place(world: World, frames: Frames) -> None:
    """Put the robot's geoms where frames of its bodies say."""
    for b in range(frames.p.shape[0]):
        place_body(world, frames, b)


@leaf
def place_body(world: World, frames: Frames, b: int) -> None:
    """Put the geoms of one body where its frame says."""
    R = frames.R[b]
    for k in range(world.first[b], world.first[b + 1]):
        g, L = world.geom[k], world.rotation[k]
        to_world(R, frames.p[b], world.position[k], world.place[g])
        for r in range(3):
            for c in range(3):
                world.axes[g, 3 * r + c] = R[r, 0] * L[0, c] + R[r, 1] * L[1, c] + R[r, 2] * L[2, c]


@leaf
def _nearer(world: World, g: int, other: int, best: float, ends: Array) -> float:
    """Return the distance of two geoms if it is less than `best`, and write the points that have it; else `best`.

    `ends` is (3, 6): both points, and two rows to work in.
    """
    # MuJoCo measures up to a distance that is not negative.
    distance = geom_distance(world.model, world.data, g, other, max(best, 1e-9), ends[1].ctypes.data)
    if not distance < best:
        return best
    for r in range(6):
        ends[0, r] = ends[1, r]
    return distance


@leaf
def surface_clearance(
    surface: tuple[Array, Array], least: tuple[float, float], world: World, b: int, best: float, ends: Array
) -> tuple[float, float]:
    """Return by how much body `b` is farther than it may be from a surface, `best` if beyond, and how far it may be.

    Arguments are as in `surface_rows`; for `ends` see `_nearer`.
    """
    points, balls = surface
    used = 0.0
    for k in range(world.first[b], world.first[b + 1]):
        g, off = world.geom[k], least[0] if world.is_tip[k] else least[1]
        for m in range(len(balls)):
            if _before_box(world, k, balls[m]) - balls[m, 3] >= best + off:
                continue
            for i in range(points.shape[1]):
                if _before_box(world, k, points[m, i]) < best + off:
                    for r in range(3):
                        world.place[world.probe, r] = points[m, i, r]
                    distance = _nearer(world, g, world.probe, best + off, ends)
                    if distance < best + off:
                        best, used = distance - off, off
    return best, used


@leaf
def _before_box(world: World, k: int, point: Array) -> float:
    """Return the signed distance of a point (3,) from the box around geom `k`, m: no more than that from the geom."""
    g, inside, squared = world.geom[k], -np.inf, 0.0
    for c in range(3):
        along = -world.box[k, c]
        for r in range(3):
            along += world.axes[g, 3 * r + c] * (point[r] - world.place[g, r])
        beyond = abs(along) - world.box[k, 3 + c]
        inside, squared = max(inside, beyond), squared + max(beyond, 0.0) ** 2
    return min(inside, 0.0) + squared**0.5


@leaf
def table_clearance(world: World, b: int, best: float, but_tips: bool, ends: Array) -> float:
    """Return the clearance of body `b` from the table, `best` if beyond; for `ends` see `_nearer`."""
    if b < world.base:
        return best
    for k in range(world.first[b], world.first[b + 1]):
        g = world.geom[k]
        if not (but_tips and world.is_tip[k]) and world.place[g, 2] - world.reach[k] < best:
            best = _nearer(world, g, world.table, best, ends)
    return best


@leaf
def part_clearance(
    world: World, b: int, start: int, end: int, best: float, but_tips: bool, ends: Array
) -> float:
    """Return the clearance of body `b` from parts `start` to `end`, `best` if beyond; for `ends` see `_nearer`."""
    for k in range(world.first[b], world.first[b + 1]):
        if but_tips and world.is_tip[k]:
            continue
        g = world.geom[k]
        for m in range(start, end):
            reach = max(world.reach[k] + best, 0.0)  # within the box nothing is known
            if from_box(world, m, world.place[g]) <= reach * reach:
                best = _nearer(world, g, world.part[m], best, ends)
    return best


@leaf
def from_box(world: World, m: int, point: Array) -> float:
    """Return the squared distance of a point (3,) from the box around part `m`, m^2."""
    squared = 0.0
    for r in range(3):
        squared += max(world.low[m, r] - point[r], point[r] - world.high[m, r], 0.0) ** 2
    return squared


@leaf
def self_clearance(world: World, a: int, b: int, best: float, ends: Array) -> float:
    """Return the clearance between two bodies, `best` if beyond; for `ends` see `_nearer`."""
    for k in range(world.first[a], world.first[a + 1]):
        g = world.geom[k]
        for m in range(world.first[b], world.first[b + 1]):
            other = world.geom[m]
            reach = world.reach[k] + world.reach[m] + best
            if reach > 0.0 and squared_way(world.place[g], world.place[other]) < reach * reach:
                best = _nearer(world, g, other, best, ends)
    return best


@leaf
def squared_way(a: Array, b: Array) -> float:
    """Return the squared distance of two points (3,), m^2."""
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2


@leaf
def _write(
    rows: Rows,
    n: int,
    value: float,
    label: tuple[int, int, int],
    ends: Array,
    tree: RobotTree,
    frames: Frames,
) -> int:
    """Write row `n`, with the gradient where there is one, and return how many there are now.

    It is along the way between both points, which overlaps turn; bodies that just touch have none.
    """
    rows.values[n], rows.gradients[n] = value, 0.0
    rows.labels[n, 0], rows.labels[n, 1], rows.labels[n, 2] = label
    first, second, direction = ends[0, :3], ends[0, 3:], ends[2]
    way = np.sqrt(squared_way(first, second))
    if way > 1e-12:
        for r in range(3):
            direction[r] = (first[r] - second[r]) / (way if value > 0.0 else -way)
        add_row(rows.gradients[n], label[1], first, direction, 1.0, tree, frames)
        if label[2] >= 0:
            add_row(rows.gradients[n], label[2], second, direction, -1.0, tree, frames)
    return n + 1
