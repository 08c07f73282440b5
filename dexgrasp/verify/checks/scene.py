"""The judge's own kinematics and distances: the robot, the object's parts and the table as MuJoCo has them."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from dexgrasp.geometry.exact import Closest, closest_on_mesh
from dexgrasp.grasp.record import GraspRecord
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.model import robot_spec
from dexgrasp_env.robot.names import GRASP_FINGERS

FAR = 0.05  # m: distances beyond are not measured
PLINTH_BODIES = 3  # links 0 to 2 stand on the arm's plinth, not over the table


@dataclass(frozen=True)
class Touch:
    """Where the three tips of a configuration are, and what of the object's parts is nearest to each.

    Attributes:
        tips: (3, 3) m, centres of thumb, index, middle.
        axes: (3, 3) unit, out of each tip.
        pads: (3, 3) unit, out of each pad.
        distance: (3,) m, of the centres from the nearest part.
        points: (3, 3) m on it.
        normals: (3, 3) unit, out of it.
        jacobians: (3, 3, 16) of those points, as the distal links carry them, by the hand's joints.
    """

    tips: Array
    axes: Array
    pads: Array
    distance: Array
    points: Array
    normals: Array
    jacobians: Array


class Scene:
    """Robot, object and table of one record."""

    def __init__(self, record: GraspRecord) -> None:
        """Compile them; the geoms of the object's parts bear the names `object0` on, the table's `table`."""
        self.parts = [_hull(vertices) for vertices in record.parts]
        self.hull = self.parts[0] if len(self.parts) == 1 else _hull(record.hull)
        spec = _bare(robot_spec(record.mount))
        for k, part in enumerate(self.parts):
            mesh = spec.add_mesh(name=f"part{k}")
            mesh.uservert = np.asarray(part.vertices).ravel()
            mesh.userface = np.asarray(part.faces).ravel()
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
            spec.worldbody.add_geom(name=f"object{k}", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"part{k}")
        spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
        self.model: mujoco.MjModel = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.object = {self.model.geom(f"object{k}").id for k in range(len(self.parts))}
        self.table = self.model.geom("table").id
        self._tip_geoms = {self.model.geom(f"{finger}_tip").id for finger in GRASP_FINGERS}

    def place(self, q: Array) -> None:
        """Put the robot at `q` (23,) rad."""
        self.data.qpos[:23] = q
        mujoco.mj_forward(self.model, self.data)

    def touch(self, q: Array) -> Touch:
        """Return where the tips of `q` (23,) are on the object."""
        self.place(q)
        tips = np.array([self.data.site(f"{finger}_tip").xpos for finger in GRASP_FINGERS])
        frames = np.array([self.data.body(f"{finger}_distal").xmat.reshape(3, 3) for finger in GRASP_FINGERS])
        distance, points, normals = self.closest(tips)
        return Touch(
            tips, frames[:, :, 2], frames[:, :, 0], distance, points, normals, self.jacobians(points)
        )

    def closest(self, points: Array) -> Closest:
        """Return what of the parts is closest to points (N, 3) m outside; inside, how deep they lie in the deepest."""
        found = [closest_on_mesh(part, points) for part in self.parts]
        nearest = np.argmin([part.distances for part in found], axis=0)
        each = np.arange(len(points))
        return Closest(*(np.stack(values)[nearest, each] for values in zip(*found, strict=True)))

    def jacobians(self, points: Array) -> Array:
        """Return the Jacobians (3, 3, 16) of points (3, 3) m of the distal links, where the robot is now."""
        found, J = [], np.zeros((3, self.model.nv))
        for finger, point in zip(GRASP_FINGERS, points, strict=True):
            mujoco.mj_jac(self.model, self.data, J, None, point, self.model.body(f"{finger}_distal").id)
            found.append(J[:, 7:23].copy())
        return np.array(found)

    def palm(self, q: Array) -> tuple[Array, Array]:
        """Return position (3,) m and rotation (3, 3) of the palm at `q` (23,)."""
        self.data.qpos[:23] = q
        mujoco.mj_kinematics(self.model, self.data)
        site = self.data.site("palm")
        return site.xpos.copy(), site.xmat.reshape(3, 3).copy()

    def clearances(self, q: Array, tips_touch: bool) -> dict[str, float]:
        """Return the least distances, m, of the true collision shapes: hand and arm to object, table, themselves."""
        self.place(q)
        robot = [
            g
            for g in range(self.model.ngeom)
            if self.model.geom_contype[g] and g != self.table and g not in self.object
        ]
        moving = [g for g in robot if self.model.body_weldid[self.model.geom_bodyid[g]] != 0]
        apart = self._tip_geoms if tips_touch else set()
        return {
            "hand_object": self._least([(g, part) for g in moving if g not in apart for part in self.object]),
            "hand_table": self._least([(g, self.table) for g in moving if not self._on_plinth(g)]),
            "self": self._least(self._pairs(robot)),
        }

    def first_contact(self, path: Array, with_object: bool = True) -> tuple[int, float]:
        """Return the first row of a path (T, 23) in which anything touches, or -1, and the deepest penetration, m."""
        deepest = 0.0
        for row, q in enumerate(path):
            self.data.qpos[:23] = q
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_collision(self.model, self.data)
            for k in range(self.data.ncon):
                contact = self.data.contact[k]
                pair = {int(contact.geom[0]), int(contact.geom[1])}
                if pair & self.object and (not with_object or pair <= self.object | {self.table}):
                    continue
                if self.table in pair and self._on_plinth(next(iter(pair - {self.table}))):
                    continue
                deepest = min(deepest, float(contact.dist))
            if deepest < 0.0:
                return row, -deepest
        return -1, 0.0

    def _on_plinth(self, geom: int) -> bool:
        name = self.model.geom(geom).name
        return name.startswith("panda_link") and int(name[10]) < PLINTH_BODIES

    def _least(self, pairs: list[tuple[int, int]]) -> float:
        from_to = np.zeros(6)
        return min(
            (mujoco.mj_geomDistance(self.model, self.data, a, b, FAR, from_to) for a, b in pairs), default=FAR
        )

    def _pairs(self, geoms: list[int]) -> list[tuple[int, int]]:
        """Pairs that may collide in the simulation: not of one body, of neighbours, or excluded by the model."""
        model = self.model
        excluded = {(int(s) >> 16, int(s) & 0xFFFF) for s in model.exclude_signature}
        pairs = []
        for i, a in enumerate(geoms):
            for b in geoms[i + 1 :]:
                one, two = sorted((int(model.geom_bodyid[a]), int(model.geom_bodyid[b])))
                welded = model.body_weldid[one] == model.body_weldid[two]
                parent = model.body_weldid[model.body_parentid[model.body_weldid[two]]]
                neighbours = parent == model.body_weldid[one]
                if not (welded or neighbours or (one, two) in excluded or (two, one) in excluded):
                    pairs.append((a, b))
        return pairs


def _hull(vertices: Array) -> Any:
    import trimesh

    return trimesh.Trimesh(vertices, process=False).convex_hull


def _bare(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Take away what is only seen: it would cost nine tenths of the compilation."""
    for geom in list(spec.geoms):
        if geom.contype == 0 and geom.conaffinity == 0:
            spec.delete(geom)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    return spec
