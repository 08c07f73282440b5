"""True distances between bodies of which covering spheres can tell nothing: those that a robot's tree leaves out."""

from functools import lru_cache

import mujoco
import numpy as np

from dexgrasp.kinematics.pairs import solid_geoms
from dexgrasp.kinematics.tree import body_pairs, robot_tree
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
    """Pairs of geoms of the bodies that a motion can bring together and that are no pair of the tree."""
    robot, model = cell.robot, compiled_robot(cell)
    kept = {(a, b) for a, b in robot_tree(cell).pairs.tolist()}
    missing = [pair for pair in body_pairs(robot, model) if pair not in kept]
    solid = {k: solid_geoms(model, model.body(robot.bodies[k]).id) for pair in missing for k in pair}
    return tuple((g, h) for a, b in missing for g in solid[a] for h in solid[b])
