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
    Rows,
    clearance_rows,
    clearances,
    room_for_all,
)
from dexgrasp.mechanics.kinematics.forward import empty_frames, forward
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.tree import RobotTree, robot_tree
from dexgrasp.mechanics.kinematics.world import World, make_world
from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import njit
from dexgrasp_env.robot.cell import Cell

_FINGERS = 0.002  # m between bodies of the hand: neighbouring fingers are built 4 mm apart and less
_CLOSER = 5e-4  # m that bodies may come nearer than at the ends of a path
_DEEPEST = -0.005  # m that they may overlap there, by errors of perception


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
        rows, needed = room_for_all(self.tree), self._needed - slack
        # rad of any joint between two checked states: under 12 mm of the fingertips
        k = _first_contact(densify(path, 0.015), self.tree, self._world, needed, self.margin, rows)
        if k < 0:
            return None
        kind, body, other = rows.labels[k]
        name = self._bodies[other] if kind == SELF else ("object" if kind == OBJECT else "table")
        return Contact((self._bodies[body], name), float(rows.values[k]))


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


@njit
def _first_contact(
    path: Array, tree: RobotTree, world: World, needed: Array, margin: float, rows: Rows
) -> int:
    """Write the clearances at the first configuration that is too near, return which one is; -1 where none is."""
    frames = empty_frames(tree)
    for i in range(path.shape[0]):
        forward(path[i], tree, frames)
        for k in range(clearance_rows(tree, frames, world, margin, False, rows)):
            kind, body, other = rows.labels[k]
            column = other if kind == SELF else len(needed) + (kind != OBJECT)
            if rows.values[k] < needed[body, column]:
                return k
    return -1
