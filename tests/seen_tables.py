"""Clouds of tables that are not where a cell has them, made point by point, and how near a robot comes to a plane."""

from pathlib import Path

import mujoco
import numpy as np
from robots import ARM_BODIES, CELL
from scipy.spatial.transform import Rotation

from dexgrasp_env.perception.pipeline import find_object
from dexgrasp_env.perception.scan import cloud_of
from dexgrasp_env.perception.selection import TargetSelector
from dexgrasp_env.poses import rigid
from dexgrasp_env.robot.model import robot_spec

AMID = np.array([0.52, 0.0, 0.0])
CLOUDS = [folder / "shared" / "cases" / "clouds" for folder in Path(__file__).parents]
GIVEN = next((folder for folder in CLOUDS if folder.is_dir()), CLOUDS[0])
"""Captures that nobody here made, beside the checkout; not everybody has them."""


def find(points, seed=0, cell=CELL, **pointing):
    """The object of a cloud (N, 3) m, pointed at or not."""
    selector = TargetSelector(**{name: np.array(value) for name, value in pointing.items()})
    return find_object(cloud_of(points), np.random.default_rng(seed), cell, selector=selector)


def leaning(height, degrees=0.0, towards=0.0, about=AMID):
    """Pose of a table that is `height` m higher and leans by a turn about a level axis through a point of it."""
    axis, angle = np.array([-np.sin(towards), np.cos(towards), 0.0]), np.radians(degrees)
    R = Rotation.from_rotvec(-angle * axis).as_matrix()
    return rigid(R, about + np.array([0.0, 0.0, height]) - R @ about)


def flat(rng, low, high, z=0.0, spacing=0.004):
    """Points of a level rectangle from `low` to `high` (2,) m."""
    count = int(np.prod(np.subtract(high, low)) / spacing**2)
    return np.c_[rng.uniform(low, high, (count, 2)), np.full(count, z)]


def block(rng, centre, sides, foot=0.0, spacing=0.003):
    """Points of a box's top and of its sides; its foot is at z = `foot`."""
    (x, y), (a, b, c) = centre, sides
    faces = [flat(rng, (x - a / 2, y - b / 2), (x + a / 2, y + b / 2), foot + c, spacing)]
    for s in (-1, 1):
        one, two = (
            flat(rng, (0, -b / 2), (c, b / 2), 0, spacing),
            flat(rng, (0, -a / 2), (c, a / 2), 0, spacing),
        )
        faces.append(np.c_[np.full(len(one), x + s * a / 2), y + one[:, 1], foot + one[:, 0]])
        faces.append(np.c_[x + two[:, 1], np.full(len(two), y + s * b / 2), foot + two[:, 0]])
    return np.concatenate(faces)


def seen_at(rng, T, *surfaces, noise=0.001, hidden=((), ())):
    """The points of surfaces in a frame that has pose T (4, 4) in the robot's, with noise."""
    points = np.concatenate(surfaces)
    return points @ T[:3, :3].T + T[:3, 3] + rng.normal(0.0, noise, points.shape)


def without(points, centre, sides):
    """Points of a table, but those under a box."""
    under = (np.abs(points[:, :2] - centre) < 0.5 * np.array(sides[:2])).all(1)
    return points[~under]


def standing(rng, centre, sides, low=(0.2, -0.4), high=(0.85, 0.4)):
    """A table with a box on it."""
    return without(flat(rng, low, high), centre, sides), block(rng, centre, sides)


def height_over(content, T):
    """Least height, m, of the robot's true shapes over the plane z = 0 of a frame T (4, 4), in all that a file does."""
    spec = robot_spec(CELL)
    spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    model = spec.compile()
    data, table, from_to = mujoco.MjData(model), model.geom("table").id, np.zeros(6)
    beside = {model.body(name).id for name in ARM_BODIES[:3]} | {0}
    geoms = [g for g in range(model.ngeom) if model.geom_contype[g] and model.geom_bodyid[g] not in beside]
    rows = [content[name] for name in ("q", "pregrasp", "grasp", "squeeze")]
    rows += [row for phase in content["script"]["phases"] for row in phase["setpoints"][::2]]
    least = np.inf
    for q in rows:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        data.geom_xpos[table], data.geom_xmat[table] = T[:3, 3], T[:3, :3].ravel()
        apart = (mujoco.mj_geomDistance(model, data, g, table, 1.0, from_to) for g in geoms)
        least = min(least, *apart)
    return least
