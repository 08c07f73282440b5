"""Checks that configurations of the whole robot are free of the object, the table and the robot itself."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.geometry.surface_samples import triangle_samples
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.trajectory import densify
from dexgrasp.mechanics.kinematics.clearance import (
    OBJECT,
    SELF,
    TABLE,
    clearances,
    from_box,
    part_clearance,
    place,
    self_clearance,
    squared_way,
    table_clearance,
)
from dexgrasp.mechanics.kinematics.forward import Frames, empty_frames, forward, to_world
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.tree import RobotTree, robot_tree
from dexgrasp.mechanics.kinematics.world import World, make_world
from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.compiled import leaf, njit
from dexgrasp_env.robot.cell import Cell

_NEAR, _AROUND = 0.004, 0.016  # m beyond the margin up to which bodies, and parts, are measured
_FINGERS = 0.002  # m between bodies of the hand: neighbouring fingers are built 4 mm apart and less
_CLOSER = 5e-4  # m that bodies may come nearer than at the ends of a path
_DEEPEST = -0.005  # m that they may overlap there, by errors of perception
_ROUNDING = 1e-9  # m


class Contact(NamedTuple):
    """Why a path is not free: which bodies, and their clearance, m."""

    bodies: tuple[str, str]
    clearance: float

    def __str__(self) -> str:
        return f"{self.bodies[0]} {1000 * self.clearance:.0f} mm from {self.bodies[1]}"


class CollisionChecker:
    """Clearance of the whole robot from objects (tips included), the table plane z = 0 and itself."""

    def __init__(self, cell: Cell, obstacle: ConvexDistance | None, margin: float = 0.004) -> None:
        """Prepare.

        Args:
            cell: of the robot.
            obstacle: the object in the world frame, with what stands around it; once the hand holds it, the latter
                alone; None when there is nothing.
            margin: clearance to keep, m.
        """
        self.tree, self.margin, self._bodies = robot_tree(cell), margin, cell.robot.bodies
        self._world = make_world(cell.seeing(None), obstacle, None)
        bodies = len(self.tree.parent)
        # Clearance to keep for body a and body b; columns nb and nb + 1 are the object and the table.
        self._needed, hand = np.full((bodies, bodies + 2), margin), slice(self.tree.palm, bodies)
        self._needed[hand, hand] = min(margin, _FINGERS)

    def allow(self, q: Array) -> None:
        """Allow a path to begin or end at `q` (n,) though bodies are nearer there than the margin.

        They may come as near as there, but overlap by no more than 5 mm.
        """
        values, labels = clearances(q, self.tree, self._world, self.margin, False)
        kind, body, other = labels.T
        column = np.where(kind == SELF, other, len(self._needed) + (kind != OBJECT))
        np.minimum.at(self._needed, (body, column), np.maximum(values - _CLOSER, _DEEPEST))

    def free(self, *path: Array) -> bool:
        """Return True for a free configuration (n,) rad, or the straight joint line between two."""
        return self.first_contact(np.stack(path)) is None

    def first_contact(self, path: Array, slack: float = 0.0) -> Contact | None:
        """Return the first contact found on a polyline of configurations (k, n) rad, or None.

        Args:
            path: its corners.
            slack: how much nearer than the margin may pass, m: for paths that follow a checked one.
        """
        nb, pairs = len(self._needed), len(self.tree.pairs)
        known = np.zeros((2, nb)), np.full((2, nb), -1.0), np.full((2, pairs), -1.0)
        label = np.empty(3, np.int64)
        watch = _Watch(self._needed - slack, self.margin, *known, label)
        # rad of any joint between two checked states: under 12 mm of the fingertips
        value = _first_contact(densify(path, 0.015), self.tree, self._world, watch)
        if value == np.inf:
            return None
        other = self._bodies[label[2]] if label[0] == SELF else ("object" if label[0] == OBJECT else "table")
        return Contact((self._bodies[label[1]], other), value)


def carried_into(target: GraspTarget, path: Array, tree: RobotTree, start: Array | None = None) -> float:
    """Return how far, m, an object in the hand gets into its neighbours along a path, 0 where it does not.

    As deep as it lies in them to begin with, by errors of perception, it may stay.

    Args:
        target: as it lies before the lift.
        path: (k, n) rad, with rows so close that nothing happens between them.
        tree: the robot.
        start: (n,) rad, where the hand has taken it; the first row by default.
    """
    R, p = palm_frame(path[0] if start is None else start, tree)
    frames = (palm_frame(q, tree) for q in path)
    return _moved_into(target, p, ((now @ R.T, at) for now, at in frames))


def raised_into(target: GraspTarget, height: float) -> float:
    """Return how far, m, an object gets into its neighbours on a straight way up of `height` m, however it is held."""
    # m between looks at an object that is raised
    ways = np.linspace(0.0, height, round(height / 0.005) + 1)[1:]
    return _moved_into(target, np.zeros(3), ((np.eye(3), np.array([0.0, 0.0, up])) for up in ways))


def _moved_into(target: GraspTarget, origin: Array, poses: Iterable[tuple[Array, Array]]) -> float:
    """Return how much deeper, m, an object gets into its neighbours at poses of a frame at `origin`."""
    if target.around is None:
        return 0.0
    points = triangle_samples(target.distance.triangles, 200, 0).points  # points of an object in the hand
    held = np.concatenate([points, target.corners]) - origin
    deepest = least = min(target.around.distance(held + origin).min(), 0.0)
    for turn, at in poses:
        deepest = min(deepest, target.around.distance(held @ turn.T + at).min())
    return max(least - deepest - 0.0015, 0.0)  # m that it may get deeper into a neighbour


class _Watch(NamedTuple):
    """Clearances to keep, and what is known of them along a path: none changes by more than bodies move.

    A clearance is measured again when what the bodies have moved since could have used it up.
    """

    needed: Array  # (nb, nb + 2) m, clearance to keep between bodies, from the object, and from the table
    margin: float  # m: more is never needed
    ways: Array  # (2, nb) m, how far each body has moved so far: in the world, and against the palm
    to_object: Array  # (2, nb) m: clearance from the object when it was measured, and the way up to then
    to_self: Array  # (2, np) m: the same between two bodies
    label: Index  # (3,) of what was too near: kind, body, other body


@njit
def _first_contact(path: Array, tree: RobotTree, world: World, watch: _Watch) -> float:
    """Return the clearance at the first contact, infinity if there is none; the watch's label says between which."""
    frames, before, seen, seen_before = (
        empty_frames(tree), empty_frames(tree), empty_frames(tree), empty_frames(tree),
    )  # fmt: skip
    bounds, ends = np.empty_like(frames.p), np.empty((3, 6))
    for i in range(path.shape[0]):
        forward(path[i], tree, frames)
        _seen_from(frames, tree.palm, seen)
        if i > 0:
            _add_ways(world, frames, before, watch.ways[0])
            _add_ways(world, seen, seen_before, watch.ways[1])
        place(world, frames)
        for b in range(bounds.shape[0]):
            to_world(frames.R[b], frames.p[b], world.bound_centre[b], bounds[b])
        value = _object_contact(world, bounds, watch, ends)
        if value == np.inf:
            value = _self_contact(tree, world, bounds, watch, ends)
        if value < np.inf:
            return value
        frames, before, seen, seen_before = before, frames, seen_before, seen
    return np.inf


@leaf
def _object_contact(world: World, bounds: Array, watch: _Watch, ends: Array) -> float:
    """Return a clearance from table or object that is less than needed, infinity if there is none."""
    needed, margin, label, known = watch.needed, watch.margin, watch.label, watch.to_object
    nb, parts = bounds.shape[0], world.part.shape[0]
    for b in range(2, nb):
        radius = world.bound_radius[b]
        if radius < 0.0:
            continue
        value = table_clearance(world, b, margin, False, ends)
        if value < min(needed[b, nb + 1], margin):
            label[0], label[1], label[2] = TABLE, b, -1
            return value
        way = watch.ways[0, b]
        if parts == 0 or known[0, b] - (way - known[1, b]) > margin:
            continue
        value = np.inf
        for m in range(parts):
            value = min(value, np.sqrt(from_box(world, m, bounds[b])) - radius)
        if value <= margin:
            value = part_clearance(world, b, 0, parts, margin + _AROUND, False, ends)
        known[0, b], known[1, b] = value, way
        if value < min(needed[b, nb], margin):
            label[0], label[1], label[2] = OBJECT, b, -1
            return value
    return np.inf


@leaf
def _self_contact(tree: RobotTree, world: World, bounds: Array, watch: _Watch, ends: Array) -> float:
    """Return a clearance between two bodies that is less than needed, infinity if there is none."""
    needed, margin, label = watch.needed, watch.margin, watch.label
    known, ways, radius = watch.to_self, watch.ways[1], world.bound_radius
    for k in range(tree.pairs.shape[0]):
        a, b = tree.pairs[k, 0], tree.pairs[k, 1]
        way = ways[a] + ways[b]
        if known[0, k] - (way - known[1, k]) > margin:
            continue
        value = np.sqrt(squared_way(bounds[a], bounds[b])) - radius[a] - radius[b]
        if value <= margin:
            value = self_clearance(world, a, b, margin + _NEAR, ends)
        known[0, k], known[1, k] = value, way
        if value < min(needed[a, b], margin):
            label[0], label[1], label[2] = SELF, a, b
            return value
    return np.inf


@leaf
def _add_ways(world: World, now: Frames, before: Frames, way: Array) -> None:
    """Add to `way` (nb,) how far (m) each body's shapes can have moved: the middle's way, and the turn's."""
    centre, radius, R, p, R0, p0 = world.bound_centre, world.bound_radius, now.R, now.p, before.R, before.p
    for b in range(p.shape[0]):
        shift, turn = 0.0, 0.0
        for r in range(3):
            d = p[b, r] - p0[b, r]
            for c in range(3):
                t = R[b, r, c] - R0[b, r, c]
                d += t * centre[b, c]
                turn += t * t
            shift += d * d
        way[b] += np.sqrt(shift) + np.sqrt(turn) * max(radius[b], 0.0) + _ROUNDING


@leaf
def _seen_from(frames: Frames, a: int, seen: Frames) -> None:
    """Write the frames of all bodies in the frame of body `a`."""
    R, p = frames.R, frames.p
    for b in range(p.shape[0]):
        for r in range(3):
            seen.p[b, r] = 0.0
            for k in range(3):
                seen.p[b, r] += R[a, k, r] * (p[b, k] - p[a, k])
            for c in range(3):
                seen.R[b, r, c] = R[a, 0, r] * R[b, 0, c] + R[a, 1, r] * R[b, 1, c] + R[a, 2, r] * R[b, 2, c]
