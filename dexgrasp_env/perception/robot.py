"""The robot's own points, removed by what its joints say (proprioception is no cheating)."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from dexgrasp_env.arrays import Array, Index, Mask
from dexgrasp_env.poses import quat_to_matrix
from dexgrasp_env.robot.hulls import mesh_of, planes_of

if TYPE_CHECKING:
    import mujoco


Own = Callable[[Array], Mask]
"""Tells which of points (M, 3) m, world frame, are the robot's own."""


class RobotShape:
    """The collision geoms of a robot as convex solids whose distance is cheap.

    Spheres, capsules, boxes, cylinders and ellipsoids are what they are (ellipsoids a little larger); meshes
    are their convex hulls.
    """

    def __init__(self, model: "mujoco.MjModel") -> None:
        """Read the geoms of the robot, or of a scene with it."""
        import mujoco

        self.geoms = robot_geoms(model)
        self._types, self._sizes = model.geom_type[self.geoms], model.geom_size[self.geoms]
        self._radii = model.geom_rbound[self.geoms]
        self._facets = {
            k: planes_of(mesh_of(model, g)[0].astype(float))
            for k, g in enumerate(self.geoms)
            if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH
        }
        bodies, which = np.unique(model.geom_bodyid[self.geoms], return_inverse=True)
        self._covers = np.array([self._cover(model, body) for body in bodies])[which]

    def at(self, data: "mujoco.MjData", margin: float = 0.012) -> Own:
        """Return what tells the points within `margin` metres of the robot where `data` has it (current kinematics).

        They may be farther from what a link collides with, by as much as its covers stand out of it: those are seen.
        """

        def own(points: Array) -> Mask:
            """Tell which of points (M, 3) m are the robot's."""
            inside = np.zeros(len(points), bool)
            if not len(points):
                return inside
            margins = margin + self._covers
            low, high, positions = points.min(0), points.max(0), data.geom_xpos[self.geoms]
            reach = (self._radii + margins)[:, None]
            near = ((positions + reach >= low) & (positions - reach <= high)).all(-1)
            for k in np.flatnonzero(near):
                local = points - positions[k]
                rows = np.flatnonzero((local * local).sum(-1) <= reach[k] ** 2)
                local = local[rows] @ data.geom_xmat[self.geoms[k]].reshape(3, 3)
                inside[rows] |= self._distance(int(k), local) <= margins[k]
            return inside

        return own

    def _cover(self, model: "mujoco.MjModel", body: int) -> float:
        """Return how far the meshes of a body that are only seen stand out of its geoms that collide, m."""
        import mujoco

        meshes = (model.geom_bodyid == body) & (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
        seen = np.setdiff1d(np.flatnonzero(meshes), self.geoms)
        if not len(seen):
            return 0.0
        points = np.concatenate(
            [mesh_of(model, g)[0] @ quat_to_matrix(model.geom_quat[g]).T + model.geom_pos[g] for g in seen]
        )
        of_body = np.flatnonzero(model.geom_bodyid[self.geoms] == body)
        away = [
            self._distance(int(k), (points - model.geom_pos[g]) @ quat_to_matrix(model.geom_quat[g]))
            for k, g in zip(of_body, self.geoms[of_body], strict=True)
        ]
        return max(0.0, float(np.min(away, axis=0).max()))

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


def robot_geoms(model: "mujoco.MjModel") -> Index:
    """Return the collision geoms of bodies that are moved by joints, and of what such bodies are mounted on.

    What stands on the table moves freely or not at all.
    """
    import mujoco

    driven = ~np.isin(model.jnt_type, (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL))
    roots = np.unique(model.body_rootid[model.jnt_bodyid[driven]])
    colliding = (model.geom_contype > 0) | (model.geom_conaffinity > 0)
    return np.flatnonzero(colliding & np.isin(model.body_rootid[model.geom_bodyid], roots))
