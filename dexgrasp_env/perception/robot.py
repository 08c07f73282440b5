"""The robot's own points, removed by what its joints say (proprioception is no cheating)."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array
from dexgrasp_env.perception.cloud import Cloud

if TYPE_CHECKING:
    import mujoco


class RobotShape:
    """The collision geoms of a robot as convex solids whose distance is cheap.

    Spheres, capsules, boxes, cylinders and ellipsoids are what they are (ellipsoids a little larger); meshes
    are their convex hulls.
    """

    def __init__(self, model: "mujoco.MjModel", geoms: Iterable[int] | None = None) -> None:
        """Read the geoms.

        Args:
            model: the robot, or a scene with it.
            geoms: ids of its collision geoms; None takes `robot_geoms(model)`.
        """
        self.geoms = np.array(sorted(robot_geoms(model) if geoms is None else geoms), dtype=int)
        self._types = model.geom_type[self.geoms].copy()
        self._sizes = model.geom_size[self.geoms].copy()
        self._radii = model.geom_rbound[self.geoms].copy()
        self._facets = [_mesh_facets(model, g) for g in self.geoms]

    def contains(self, points: Array, data: "mujoco.MjData", margin: float) -> NDArray[np.bool_]:
        """Return which points (M, 3) lie within `margin` metres of the robot as `data` has it.

        `data` needs current kinematics.
        """
        inside = np.zeros(len(points), bool)
        if not len(points):
            return inside
        low, high = points.min(0) - margin, points.max(0) + margin
        positions = data.geom_xpos[self.geoms]
        reach = self._radii[:, None]
        near = ((positions + reach >= low) & (positions - reach <= high)).all(-1)
        for k in np.flatnonzero(near):
            local = points - positions[k]
            rows = np.flatnonzero((local * local).sum(-1) <= (self._radii[k] + margin) ** 2)
            local = local[rows] @ data.geom_xmat[self.geoms[k]].reshape(3, 3)
            inside[rows] |= self._distance(int(k), local) <= margin
        return inside

    def _distance(self, k: int, p: Array) -> Array:
        """Return lower bounds of the distances (n,) m of local points (n, 3) to geom k."""
        import mujoco

        kind, size = self._types[k], self._sizes[k]
        types = mujoco.mjtGeom
        if kind == types.mjGEOM_SPHERE:
            return np.linalg.norm(p, axis=-1) - size[0]
        if kind == types.mjGEOM_CAPSULE:
            axis = p[:, 2] - np.clip(p[:, 2], -size[1], size[1])
            return np.sqrt(p[:, 0] ** 2 + p[:, 1] ** 2 + axis**2) - size[0]
        if kind == types.mjGEOM_CYLINDER:
            return np.maximum(np.hypot(p[:, 0], p[:, 1]) - size[0], np.abs(p[:, 2]) - size[1])
        if kind == types.mjGEOM_ELLIPSOID:
            return (np.linalg.norm(p / size, axis=-1) - 1.0) * size.min()
        if kind == types.mjGEOM_BOX:
            return (np.abs(p) - size).max(-1)
        facets = self._facets[k]
        return (p @ facets[:, :3].T + facets[:, 3]).max(-1)


def robot_geoms(model: "mujoco.MjModel", object_body: str = "object", table: str = "table") -> list[int]:
    """Return the collision geoms of all bodies but the world, the object and the table."""
    import mujoco

    ignored = {0} | {
        mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in (object_body, table)
    }
    colliding = (model.geom_contype > 0) | (model.geom_conaffinity > 0)
    return [int(g) for g in np.flatnonzero(colliding) if int(model.geom_bodyid[g]) not in ignored]


def remove_robot(cloud: Cloud, robot: RobotShape, data: "mujoco.MjData", margin: float = 0.012) -> Cloud:
    """Return the points farther than `margin` metres from the robot's collision geoms."""
    return cloud.select(~robot.contains(cloud.points, data, margin))


def _mesh_facets(model: "mujoco.MjModel", geom: int) -> Array:
    """Return the half-spaces (n, 4) of a mesh geom's hull in the geom's frame; none for other geoms."""
    import mujoco

    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH:
        return np.empty((0, 4))
    from scipy.spatial import ConvexHull

    mesh = model.mesh(int(model.geom_dataid[geom]))
    start, count = int(mesh.vertadr[0]), int(mesh.vertnum[0])
    return np.unique(
        ConvexHull(model.mesh_vert[start : start + count].astype(float)).equations.round(9), axis=0
    )
