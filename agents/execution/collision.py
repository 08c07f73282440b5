"""Whether configurations of the whole robot are free of the object, the table and the robot itself."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray

from agents.geometry.convex import NOTHING, ConvexDistance, Obstacle
from agents.kinematics.clearance import OBJECT, SELF, clearance_rows, empty_rows
from agents.kinematics.forward import body_frames, empty_frames, forward
from agents.kinematics.tree import RobotTree
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.names import BODIES

_MAX_ROWS = 128
_CHECK_STEP = 0.015  # rad of any joint between two checked states: under 12 mm of the fingertips
_OVERESTIMATE = 0.008  # m: covering spheres exceed the palm by 7 mm, a finger link by 3 mm


@dataclass(frozen=True)
class Contact:
    """The first state of a path that is not free: which bodies, and their clearance (a lower bound, m)."""

    index: int
    bodies: tuple[str, str]
    clearance: float

    def __str__(self) -> str:
        return f"{self.bodies[0]} {1000 * self.clearance:.0f} mm from {self.bodies[1]}"


class CollisionChecker:
    """Clearance of the whole robot from the object (tips included), the table plane z = 0 and itself.

    Clearances are lower bounds from covering spheres: what is called free is free.
    """

    def __init__(self, tree: RobotTree, obstacle: ConvexDistance | None, margin: float = 0.004) -> None:
        """Prepare.

        Args:
            tree: the robot.
            obstacle: the object in the robot base frame; None when there is none, or the hand holds it.
            margin: clearance to keep, m.
        """
        self.tree, self.margin = tree, margin
        self._obstacle = NOTHING if obstacle is None else obstacle.obstacle
        bodies = len(tree.parent)
        # Clearance to keep for body a and body b; columns nb and nb + 1 are the object and the table.
        self._needed = np.full((bodies, bodies + 2), margin)

    def allow(self, q: Array) -> None:
        """Let a path begin or end at `q` (23,) though bodies are nearer there than the margin.

        They may come as near as there, but no nearer than the covering spheres can be wrong (8 mm).
        """
        values, labels = self.clearances(q)
        for value, (kind, body, other) in zip(values, labels, strict=True):
            column = other if kind == SELF else len(self._needed) + int(kind != OBJECT)
            near = max(value - 5e-4, -_OVERESTIMATE)
            self._needed[body, column] = min(self._needed[body, column], near)

    def clearances(self, q: Array) -> tuple[Array, NDArray[np.int64]]:
        """Return clearances (K,) m below the margin and their labels (K, 3): kind, body, other body."""
        rows, frames = empty_rows(_MAX_ROWS), body_frames(q, self.tree)
        count = clearance_rows(self.tree, frames, self._obstacle, self.margin, False, rows)
        return rows.values[:count], rows.labels[:count]

    def free(self, q: Array) -> bool:
        """Whether `q` (23,) rad is free."""
        return self.first_contact(np.asarray(q)[None]) is None

    def free_line(self, start: Array, goal: Array) -> bool:
        """Whether the straight joint line between two configurations is free."""
        return self.first_contact(np.stack([start, goal])) is None

    def first_contact(self, path: Array, slack: float = 0.0) -> Contact | None:
        """Return the first contact along a polyline of configurations (n, 23) rad, or None.

        Args:
            path: its corners.
            slack: how much nearer than the margin may pass, m: for paths that follow a checked one.
        """
        dense = densify(path, _CHECK_STEP)
        label = np.empty(3, np.int64)
        index, value = _first_contact(
            dense, self.tree, self._obstacle, self._needed - slack, self.margin, label
        )
        if index < 0:
            return None
        other = BODIES[label[2]] if label[0] == SELF else ("object" if label[0] == OBJECT else "table")
        return Contact(index, (BODIES[label[1]], other), value)


def densify(path: Array, step: float) -> Array:
    """Return points (m, 23) on a polyline (n, 23), corners included, no joint moving over `step` rad."""
    path = np.atleast_2d(np.asarray(path, dtype=float))
    pieces = [path[:1]]
    for a, b in pairwise(path):
        count = max(1, int(np.ceil(np.abs(b - a).max() / step)))
        pieces.append(a + np.arange(1, count + 1)[:, None] / count * (b - a))
    return np.concatenate(pieces)


@njit(cache=True, error_model="numpy")
def _first_contact(
    path: Array, tree: RobotTree, obstacle: Obstacle, needed: Array, margin: float, label: NDArray[np.int64]
) -> tuple[int, float]:
    nb, frames, rows = tree.parent.shape[0], empty_frames(tree), empty_rows(_MAX_ROWS)
    values, labels = rows.values, rows.labels
    for i in range(path.shape[0]):
        forward(path[i], tree, frames)
        n = clearance_rows(tree, frames, obstacle, margin, False, rows)
        for k in range(n):
            kind, body, other = labels[k, 0], labels[k, 1], labels[k, 2]
            column = other if kind == SELF else nb + (0 if kind == OBJECT else 1)
            if values[k] < needed[body, column]:
                label[:] = labels[k]
                return i, values[k]
    return -1, 0.0
