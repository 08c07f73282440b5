"""True distances between bodies of which covering spheres can tell nothing: those that a robot's tree leaves out."""

from functools import lru_cache

import mujoco
import numpy as np

from dexgrasp.kinematics.pairs import meeting_pairs, solid_geoms
from dexgrasp.kinematics.tree import robot_tree
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.model import compiled_robot, posed

_LEAST = 0.002  # m


def shapes_apart(q: Array, cell: Cell) -> bool:
    """Whether the shapes of those bodies keep 2 mm from each other at `q` (n,) rad."""
    pairs = _left_out(cell)
    if not pairs:
        return True
    model, nothing = compiled_robot(cell), np.zeros(6)
    data = posed(model, q)
    return all(mujoco.mj_geomDistance(model, data, a, b, _LEAST, nothing) >= _LEAST for a, b in pairs)


@lru_cache(maxsize=8)
def _left_out(cell: Cell) -> tuple[tuple[int, int], ...]:
    """Pairs of geoms of the bodies that come near each other and are no pair of the tree."""
    robot, model = cell.robot, compiled_robot(cell)
    if robot.hand.frame is None:
        return ()
    kept = {(robot.bodies[a], robot.bodies[b]) for a, b in robot_tree(cell).pairs}
    missing = [pair for pair in meeting_pairs(robot, model) if pair not in kept]
    solid = {name: solid_geoms(model, model.body(name).id) for pair in missing for name in pair}
    return tuple((g, h) for a, b in missing for g in solid[a] for h in solid[b])
