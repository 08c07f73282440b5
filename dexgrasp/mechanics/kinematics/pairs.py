"""Which bodies a robot's own motion can bring together, where its files do not say: found by sampling."""

from itertools import combinations

import mujoco
import numpy as np

from dexgrasp.mechanics.kinematics.sphere_cover import Spheres
from dexgrasp_env.arrays import Mask
from dexgrasp_env.files import cached_arrays, content_hash
from dexgrasp_env.robot.model import bodies_apart, excluded_pairs, swept
from dexgrasp_env.robot.robot import Robot

_SAMPLES = 300
_NEAR = 0.01  # m between two bodies: covering spheres exceed the shapes by less
_LOOKS, _MOSTLY = 60, 0.6  # covering spheres that overlap in so many postures can tell nothing of a pair

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


def told_apart(pairs: Pairs, robot: Robot, model: mujoco.MjModel, spheres: list[Spheres]) -> Pairs:
    """Return the pairs, numbers of the robot's bodies, of which their covering spheres can tell something."""
    inside, idle = np.zeros(len(pairs)), robot.home.copy()
    for finger in robot.hand.fingers:
        if finger.aside:
            idle[robot.columns[finger.name]] = finger.aside
    weights, postures = [_LOOKS, _LOOKS] + [1] * _LOOKS, [robot.home, idle, *robot.drawn(_LOOKS)]
    for weight, data in zip(weights, swept(model, postures), strict=True):
        placed = zip(spheres, map(data.body, robot.bodies), strict=True)
        centres = [s.centre @ b.xmat.reshape(3, 3).T + b.xpos for s, b in placed]
        for k, (a, b) in enumerate(pairs):
            apart = np.linalg.norm(centres[a][:, None] - centres[b], axis=2)
            # m that they leave where fingers are open or idle, or they cannot either
            room = 0.002 if weight > 1 else 0.0
            inside[k] += weight * (apart < spheres[a].radius[:, None] + spheres[b].radius + room).any()
    return [pair for pair, often in zip(pairs, inside, strict=True) if often < _MOSTLY * _LOOKS]
