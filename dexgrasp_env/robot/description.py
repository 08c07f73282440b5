"""Description of a part of a robot as MuJoCo compiled it: bodies, shapes and where they are, joints at 0."""

from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import rigid
from dexgrasp_env.robot.hulls import corners_of
from dexgrasp_env.robot.source import read_source

_GEOM = mujoco.mjtGeom


class Description:
    """Content of a description: its bodies and shapes in the world of the file, all joints at 0.

    Attributes:
        path: of the file.
        model, data: of it.
        source: what was changed so that it compiles, and the rates that it states.
    """

    def __init__(self, path: Path) -> None:
        """Compile it.

        Raises:
            InputError: in one line, where MuJoCo cannot read it, or joints neither turn nor slide.
        """
        self.path, self.source = path, read_source(path)
        self.model = self.source.model
        valid = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
        if len(others := np.flatnonzero(~np.isin(self.model.jnt_type, valid))):
            name = self.model.joint(others[0]).name
            raise InputError(
                f"{path} has joints that neither turn nor slide, {name!r} for one: valid are hinges and slides"
            )
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = 0.0
        mujoco.mj_kinematics(self.model, self.data)

    def pose(self, body: int | str) -> Array:
        """Return the pose (4, 4) of a body."""
        return pose_of(self.data.body(body))

    def joint_ids(self, names: Iterable[str]) -> list[int]:
        """Return the numbers of joints."""
        return [self.model.joint(name).id for name in names]

    def joint_names(self, joints: Iterable[int]) -> list[str]:
        """Return the names of joints."""
        return [self.model.joint(j).name for j in joints]

    @cached_property
    def solid(self) -> Array:
        """Which geoms (ngeom,) collide; of a description in which nothing does, and of ends of chains, all."""
        m = self.model
        solid = (m.geom_contype | m.geom_conaffinity) != 0
        if not solid.any():
            return np.ones_like(solid)
        whole, bearing = (
            m.body_weldid[m.geom_bodyid],
            {*m.body_weldid[m.body_parentid[m.jnt_bodyid]].tolist()},
        )
        for body in {*m.jnt_bodyid.tolist()} - bearing:
            if not solid[whole == body].any():
                solid = solid | (whole == body)
        return solid

    def shape_points(self, geom: int) -> Array:
        """Return points (n, 3) m of a shape, or of the box around one that is no mesh, in the world of the file."""
        return (
            corners_of(self.model, geom) @ self.data.geom_xmat[geom].reshape(3, 3).T
            + self.data.geom_xpos[geom]
        )

    def box_of(self, bodies: list[int]) -> Array:
        """Return the ends (2, 3) m of a box around all shapes of bodies; nan without any."""
        own = np.flatnonzero(np.isin(self.model.geom_bodyid, bodies)).tolist()
        found = [self.shape_points(g) for g in own if self.is_solid(g)]
        points = np.concatenate(found or [np.full((1, 3), np.nan)])
        return np.array([points.min(0), points.max(0)])

    def is_solid(self, geom: int) -> bool:
        """Tell whether a shape is a solid: no plane, no field of heights."""
        return int(_GEOM.mjGEOM_SPHERE) <= self.model.geom_type[geom] <= int(_GEOM.mjGEOM_MESH)

    @staticmethod
    def is_off(centre: Array, box: Array) -> bool:
        """Tell whether a centre of mass (3,) m lies farther out of a box (2, 3) m than the box is long."""
        away = np.maximum(box[0] - centre, centre - box[1]).clip(0.0)
        return bool(np.linalg.norm(away) > np.linalg.norm(box[1] - box[0]))


def pose_of(place: Any) -> Array:
    """Return the pose (4, 4) of a body, shape or site of `mujoco.MjData`."""
    return rigid(place.xmat.reshape(3, 3), place.xpos)


def bearers(model: mujoco.MjModel, body: int) -> list[int]:
    """Return a body and those that it hangs on, from it up; the world is none of them."""
    found = []
    while body:
        found.append(body)
        body = int(model.body_parentid[body])
    return found
