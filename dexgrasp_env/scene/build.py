"""Robot, object, table and cameras put together into one model."""

from collections.abc import Iterable, Sequence
from typing import Any

import mujoco
import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.locales import with_decimal_points
from dexgrasp_env.objects.mjcf import add_to_spec
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.poses import matrix_to_quat
from dexgrasp_env.robot.camera import Camera
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.model import compiled_robot, robot_spec
from dexgrasp_env.robot.robot import Robot
from dexgrasp_env.scene.arena import add_arena, add_belt, add_furniture
from dexgrasp_env.scene.constants import FRICTION
from dexgrasp_env.scene.sensors import add_sensors
from dexgrasp_env.valid import checked


def add_cameras(spec: mujoco.MjSpec, cameras: Iterable[Camera]) -> None:
    """Add the cameras to a model under construction, fixed to the world.

    MJCF knows a centred principal point only; the depth backends use the full intrinsics whatever is written
    here.
    """
    flip = np.diag([1.0, -1.0, -1.0])  # MuJoCo's cameras look along -z with y up
    for camera in cameras:
        spec.worldbody.add_camera(
            name=camera.name,
            pos=camera.position,
            quat=matrix_to_quat(camera.rotation @ flip),
            fovy=camera.intrinsics.fovy,
            resolution=[camera.intrinsics.width, camera.intrinsics.height],
        )


def scene_spec(
    model: ObjectModel,
    cell: Cell,
    *,
    neighbours: Sequence[ObjectModel] = (),
    friction: float = FRICTION,
    cameras: tuple[Camera, ...] = (),
    furniture: str = "",
    belt: bool = False,
) -> mujoco.MjSpec:
    """Return the editable scene: robot base above or below the origin, table top at z = 0, free objects.

    Args:
        model: the object to pick up.
        cell: the robot and where it stands.
        neighbours: other objects on the table, bodies `neighbour_0`, `neighbour_1`, ... after the body `object`.
        friction: sliding friction coefficient of every contact.
        cameras: depth cameras to add, in the world frame.
        furniture: what else stands on the table: a `bin` around the objects, a `tray` beside them, or nothing.
        belt: whether the table's top is a belt that can move, the last body.
    """
    spec = robot_spec(cell)
    spec.modelname = f"dexgrasp {model.name}"
    add_arena(spec, float(cell.base[2]))
    if furniture:
        add_furniture(spec, furniture)
    parts = [_add_object(spec, "object", model)]
    parts += [_add_object(spec, f"neighbour_{k}", shape) for k, shape in enumerate(neighbours)]
    if belt:
        add_belt(spec, cell.robot.bodies[0])
    for geom in spec.geoms:
        if geom.contype or geom.conaffinity:
            geom.friction = [friction, 0.005, 0.0001]  # torsion, m: for users who raise condim
    for names in parts:
        _add_pairs(spec, names, cell.robot, friction)
    add_sensors(spec, cell.robot, len(neighbours))
    add_cameras(spec, cameras)
    return spec


@checked
def build_scene(model: ObjectModel, cell: Cell, **more: Any) -> mujoco.MjModel:
    """Compile `scene_spec`.

    Raises:
        InputError: for a robot that cannot be simulated.
    """
    compiled_robot(cell)
    return with_decimal_points(scene_spec(model, cell, **more).compile)


def _add_object(spec: mujoco.MjSpec, name: str, model: ObjectModel) -> list[str]:
    body = spec.worldbody.add_body(name=name, pos=[0.5, 0.0, 0.3])
    body.add_freejoint(name=name)
    return add_to_spec(spec, body, model, name=name)


def _add_pairs(spec: mujoco.MjSpec, parts: list[str], robot: Robot, friction: float) -> None:
    sliding, torsion = [friction, friction], robot.hand.torsion
    for part in parts:
        for tip in robot.tips:
            spec.add_pair(
                name=f"{tip}:{part}", geomname1=tip, geomname2=part, condim=4 if torsion else 3,
                friction=[*sliding, torsion * friction or 0.005, 0.0001, 0.0001],
                solref=[0.02, 1.0], solimp=[0.9, 0.95, 0.001, 0.5, 2.0], solreffriction=[0.004, 1.0],
            )  # fmt: skip
        # Rolling resistance keeps a can on its side where it was put; it has no part in the grasp.
        spec.add_pair(
            name=f"table:{part}", geomname1="table", geomname2=part, condim=6,
            friction=[*sliding, 0.005, 0.0002, 0.0002],  # torsion and rolling, m: a can on a hard table
        )  # fmt: skip


def pair_friction(base: mujoco.MjModel, friction: float) -> Array:
    """Return what `pair_friction` (P, 5) of a compiled scene is with another sliding coefficient."""
    values: Array = base.pair_friction.copy()
    soft = base.pair_dim == 4  # what turns is friction as well
    values[soft, 2] = values[soft, 2] / values[soft, 0] * friction
    values[:, :2] = friction
    return values
