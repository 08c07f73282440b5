"""The collision shapes of a robot, the convex parts around it and the table, as MuJoCo measures their distances."""

from copy import copy
from functools import lru_cache
from typing import Any, NamedTuple

import mujoco
import numpy as np

from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.mechanics.kinematics.tree import rotation_matrix
from dexgrasp_env.arrays import Array, Index, Mask, middle
from dexgrasp_env.locales import with_decimal_points
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.model import colliding, colliding_spec
from dexgrasp_env.robot.robot import Robot

_PARTS, _CORNERS = 32, 64  # there is room for so many parts of so many corners; or twice as many, and so on


class _Geoms(NamedTuple):
    """Geoms as compiled code takes them: nb bodies of a robot with ng geoms, and P convex parts around it.

    Each call of compiled code writes where the robot is and then measures. Threads can share a world: while compiled
    code runs no other thread of Python's does.
    """

    model: int  # addresses
    data: int
    place: Array  # (n, 3) m, of all geoms
    axes: Array  # (n, 9)
    part: Index  # (P,) geoms
    low: Array  # (P, 3) m, boxes around the parts
    high: Array  # (P, 3) m
    objects: int  # so many parts are the object's, the others its neighbours'
    table: int  # geom
    probe: int  # geom: a point, wherever it is put
    first: Index  # (nb + 1,): geoms of body b are first[b] .. first[b + 1]
    geom: Index  # (ng,)
    position: Array  # (ng, 3) m, body frame
    rotation: Array  # (ng, 3, 3)
    reach: Array  # (ng,) m from its middle
    box: Array  # (ng, 6) m, middle and half sides of the box around it, in its frame
    is_tip: Mask  # (ng,): the tip of a grasping finger, which may touch the object
    base: int  # the first body that is over the table, not on its plinth


class World(_Geoms):
    """Geoms, with the model and data that they are of; what was pickled has others where it is read."""

    def __reduce__(self) -> Any:
        """Return how to make it anew: addresses are those of one process."""
        return make_world, vars(self)["made_of"]


class _Robot(NamedTuple):
    """A robot's model with a table and room for parts, not to be written to."""

    model: mujoco.MjModel
    part: Index  # geoms
    corner: int  # the first that there is room for
    geoms: dict[str, Any]  # fields of `World`


@lru_cache(maxsize=8)  # a plan asks several times
def make_world(
    cell: Cell, target: ConvexDistance | None = None, beside: ConvexDistance | None = None
) -> World:
    """Return the world of a cell's robot, of an object and of what stands around it; the same at every call.

    Args:
        cell: of the robot; compiled code places it, wherever its base is: best the one that sees no table, whose worlds
            serve others too.
        target: the object's convex parts, world frame, m; None for no object.
        beside: its neighbours'.
    """
    things = [() if thing is None else thing.corners for thing in (target, beside)]
    corners, size = things[0] + things[1], _PARTS
    while size < len(corners) or size * _CORNERS < sum(map(len, corners)):
        size *= 2
    robot = _robot(cell.seeing(None), size)
    model = copy(robot.model)
    data, part = mujoco.MjData(model), robot.part[: len(corners)]
    ends = np.cumsum([robot.corner, *map(len, corners)])
    for geom, points, start, end in zip(part, corners, ends[:-1], ends[1:], strict=True):
        mesh, data.geom_xpos[geom] = model.geom_dataid[geom], middle(points)
        model.mesh_vertadr[mesh], model.mesh_vertnum[mesh] = start, end - start
        model.mesh_vert[start:end] = points - data.geom_xpos[geom]  # of single precision
    data.geom_xmat[:] = np.eye(3).ravel()
    world = World(
        model=model._address,
        data=data._address,
        place=data.geom_xpos,
        axes=data.geom_xmat,
        part=part,
        low=np.array([points.min(0) for points in corners]).reshape(-1, 3),
        high=np.array([points.max(0) for points in corners]).reshape(-1, 3),
        objects=len(things[0]),
        **robot.geoms,
    )
    vars(world).update(of=(model, data), made_of=(cell, target, beside))
    return world


@lru_cache(maxsize=8)
def _robot(cell: Cell, size: int) -> _Robot:
    """Return a robot's model with room for `size` parts; compiling takes 30 ms and more."""
    spec = colliding_spec(cell)
    spec.option, spec.memory = mujoco.MjSpec().option, 1 << 16
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT  # nothing is simulated
    corners = np.concatenate([np.eye(4, 3), np.random.default_rng(0).random((size * _CORNERS, 3))])
    for k in range(size):
        mesh = spec.add_mesh(name=f"part{k}", userface=[0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3])
        mesh.uservert = corners[: 4 if k else None].ravel()  # the first has room for those of all
        spec.worldbody.add_geom(
            name=f"part{k}", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"part{k}", contype=0, conaffinity=0
        )
    spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    spec.worldbody.add_geom(name="probe", size=[1e-6, 0, 0], contype=0, conaffinity=0)
    model = with_decimal_points(spec.compile)
    part = np.array([model.geom(f"part{k}").id for k in range(size)])
    return _Robot(model, part, int(model.mesh("part0").vertadr[0]), _geoms_of(model, cell.robot))


def _geoms_of(model: mujoco.MjModel, robot: Robot) -> dict[str, Any]:
    """Return the fields of a world that are the robot's."""
    geoms = [colliding(model, model.body(name).id) for name in robot.bodies]
    geom = np.concatenate(geoms).astype(np.int64)
    tips = {model.geom(finger.tip).id for finger in robot.grasping}
    return {
        "table": model.geom("table").id,
        "probe": model.geom("probe").id,
        "first": np.cumsum([0, *map(len, geoms)]),
        "geom": geom,
        "position": model.geom_pos[geom],
        "rotation": np.stack([rotation_matrix(q) for q in model.geom_quat[geom]]),
        "reach": model.geom_rbound[geom],
        "box": model.geom_aabb[geom],
        "is_tip": np.isin(geom, list(tips)),
        "base": min(robot.arm.plinth, 3),
    }
