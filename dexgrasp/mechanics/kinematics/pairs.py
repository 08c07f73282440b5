"""Which bodies a robot's own motion can bring together, where its files do not say: found by sampling."""

from itertools import combinations

import mujoco
import numpy as np

from dexgrasp_env.arrays import Mask
from dexgrasp_env.files import cached_arrays, content_hash
from dexgrasp_env.robot.model import bodies_apart, excluded_pairs, swept
from dexgrasp_env.robot.robot import Robot

_SAMPLES = 300
_NEAR = 0.01  # m between two bodies

Pairs = list[tuple[int, int]]


def meeting_pairs(robot: Robot, model: mujoco.MjModel) -> list[tuple[str, str]]:
    """Return the pairs of the hand's bodies that come near each other in random postures.

    Args:
        robot: whose hand it is.
        model: of the robot, compiled.

    Returns:
        Names; without neighbours along a chain, and without what the description excludes.
    """
    numbers = [model.body(name).id for name in robot.hand.bodies]
    excluded = excluded_pairs(model)
    pairs = [
        (a, b)
        for a, b in combinations(numbers, 2)
        if model.body_parentid[b] != a and frozenset((a, b)) not in excluded
    ]
    key = content_hash(_SAMPLES, _NEAR, robot.hash, model.mesh_vert)  # meshes may change and keep their names
    near = cached_arrays(f"pairs_{key}.npy", lambda: {"near": _come_near(pairs, robot, model)})["near"]
    return [(model.body(a).name, model.body(b).name) for a, b in np.array(pairs)[near]]


def _come_near(pairs: Pairs, robot: Robot, model: mujoco.MjModel) -> Mask:
    near = np.zeros(len(pairs), bool)
    for data in swept(model, robot.drawn(_SAMPLES)):
        for k in np.flatnonzero(~near):
            near[k] = bodies_apart(data, *pairs[k], _NEAR) < _NEAR
    return near
