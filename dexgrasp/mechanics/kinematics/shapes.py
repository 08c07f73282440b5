"""True distances between bodies of which covering spheres can tell nothing: those that a robot's tree leaves out."""

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dexgrasp.mechanics.kinematics.tree import body_pairs, robot_tree
from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.model import bodies_apart, compiled_robot, joints_between, swept

LEAST = 0.002
"""m that the shapes of those bodies keep from each other."""


class _Pair(NamedTuple):
    """Two bodies, their numbers in the tree and in the model, and the columns of the joints between them."""

    bodies: tuple[int, int]
    numbers: tuple[int, int]
    joints: Index


def shapes_apart(q: Array, cell: Cell) -> bool:
    """Return True where the shapes of those bodies keep `LEAST` from each other at `q` (n,) rad."""
    return next(near_shapes(q[None], cell), None) is None


def near_shapes(path: Array, cell: Cell) -> Iterator[tuple[tuple[int, int], float]]:
    """Yield pairs of those bodies whose shapes come nearer than `LEAST` along a path, and how near, m.

    Args:
        path: (k, n) rad, with rows so close that nothing happens between them.
        cell: of the robot.
    """
    for pair in _left_out(cell):
        looks = swept(compiled_robot(cell), _looked_at(path, pair.joints))
        least = min(bodies_apart(data, *pair.numbers, LEAST) for data in looks)
        if least < LEAST:
            yield pair.bodies, least


def _looked_at(path: Array, joints: Index) -> Array:
    """Return the rows of a path between which one of the joints has moved by 0.02 rad, and both ends."""
    moved = np.abs(np.diff(path[:, joints], axis=0, prepend=path[:1, joints])).max(axis=1).cumsum()
    _, first = np.unique(moved // 0.02, return_index=True)
    return path[np.union1d(first, len(path) - 1)]


@lru_cache(maxsize=8)
def _left_out(cell: Cell) -> tuple[_Pair, ...]:
    """The bodies that a motion can bring together and that are no pair of the tree."""
    robot, model = cell.robot, compiled_robot(cell)
    kept, number = robot_tree(cell).pairs.tolist(), [model.body(name).id for name in robot.bodies]
    return tuple(
        _Pair((a, b), (number[a], number[b]), joints_between(model, number[a], number[b]))
        for a, b in body_pairs(robot, model)
        if [a, b] not in kept
    )
