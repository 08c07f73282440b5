"""The judge's own kinematics and distances: the robot, the object's parts and the table as MuJoCo has them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import mujoco
import numpy as np

from dexgrasp.geometry.mesh_distance import Closest, closest_on_mesh
from dexgrasp.grasp.trajectory import densify
from dexgrasp_env.arrays import Array
from dexgrasp_env.locales import with_decimal_points
from dexgrasp_env.poses import placed
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.model import excluded_pairs, robot_spec

FAR = 0.05  # m: distances beyond are not measured
_DOT = 1e-4  # m, radius of a point of the table that was seen


@dataclass(frozen=True)
class Touch:
    """Places of the tips of a configuration, and what of the object's parts is nearest to each of the N.

    Attributes:
        tips: (N, 3) m, centres.
        axes: (N, 3) unit, out of each tip.
        pads: (N, 3) unit, out of each pad.
        distance: (N,) m, of the centres from the nearest part.
        points: (N, 3) m on it.
        normals: (N, 3) unit, out of it.
        jacobians: (N, c, m) of those points, as the last links carry them, by the hand's joints and what follows each;
            of soft tips the fourth part is their turn about the normals, times its radius.
    """

    tips: Array
    axes: Array
    pads: Array
    distance: Array
    points: Array
    normals: Array
    jacobians: Array


class Scene:
    """Robot, object, neighbours and table in the world frame."""

    def __init__(
        self, cell: Cell, parts: Sequence[Array], fingers: Sequence[str], neighbours: Sequence[Array] = ()
    ) -> None:
        """Compile them; the geoms of the object's parts bear the names `object0` on, the table's `table`.

        Args:
            cell: with the mount in use.
            parts: vertices (V, 3) m of the object's convex parts; there may be none.
            fingers: whose tips make the contacts.
            neighbours: the same of convex parts of neighbours, `around0` on.
        """
        self.cell, self.robot, self.parts = cell, cell.robot, [_hull(vertices) for vertices in parts]
        self._fingers = [self.robot.hand.finger(name) for name in fingers]
        spec = _bare(robot_spec(cell))
        named = [(f"object{k}", part) for k, part in enumerate(self.parts)]
        named += [(f"around{k}", _hull(vertices)) for k, vertices in enumerate(neighbours)]
        for name, part in named:
            mesh = spec.add_mesh(name=name)
            mesh.uservert = np.asarray(part.vertices).ravel()
            mesh.userface = np.asarray(part.faces).ravel()
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
            spec.worldbody.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)
        spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
        spec.worldbody.add_geom(name="dot", size=[_DOT, 0, 0], contype=0, conaffinity=0)
        self.model: mujoco.MjModel = with_decimal_points(spec.compile)
        self.data = mujoco.MjData(self.model)
        self.object = {self.model.geom(f"object{k}").id for k in range(len(self.parts))}
        self.neighbours = {self.model.geom(f"around{k}").id for k in range(len(neighbours))}
        self.table = self.model.geom("table").id
        self._dot = self.model.geom("dot").id
        self._seen = None if cell.table is None else placed(cell.T_world_base, cell.table.points)
        self._tip_geoms = {self.model.geom(finger.tip).id for finger in self._fingers}

    @cached_property
    def hull(self) -> Any:
        """The convex hull of all parts."""
        return _hull(np.concatenate([part.vertices for part in self.parts]))

    def place(self, q: Array) -> None:
        """Put the robot at `q` (n,) rad."""
        self.data.qpos[:] = q
        mujoco.mj_forward(self.model, self.data)

    def touch(self, q: Array) -> Touch:
        """Return where the tips of `q` (n,) are on the object."""
        self.place(q)
        tips = np.array([self.data.site(finger.tip).xpos for finger in self._fingers])
        frames = np.array([self.data.body(finger.bodies[-1]).xmat.reshape(3, 3) for finger in self._fingers])
        pads = np.array([R @ finger.pad for R, finger in zip(frames, self._fingers, strict=True)])
        distance, points, normals = self.closest(tips)
        return Touch(tips, frames[:, :, 2], pads, distance, points, normals, self.jacobians(points, normals))

    def closest(self, points: Array) -> Closest:
        """Return what of the parts is closest to points (N, 3) m outside; inside, how deep they lie in the deepest."""
        found = [closest_on_mesh(part, points) for part in self.parts]
        nearest = np.argmin([part.distances for part in found], axis=0)
        each = np.arange(len(points))
        return Closest(*(np.stack(values)[nearest, each] for values in zip(*found, strict=True)))

    def jacobians(self, points: Array, normals: Array, driven: bool = True) -> Array:
        """Return `Touch.jacobians` at points (N, 3) m of the last links, where the robot is now; normals (N, 3).

        If not `driven`, by every joint as if it had a servo.
        """
        found, torsion = [], self.robot.hand.torsion
        J, turn = np.zeros((2, 3, self.model.nv))
        by = self.robot.drive[0] if driven else np.eye(self.robot.dof)
        for finger, point, normal in zip(self._fingers, points, normals, strict=True):
            body = self.model.body(finger.bodies[-1]).id
            mujoco.mj_jac(self.model, self.data, J, turn, point, body)
            rows = np.vstack([J, torsion * normal @ turn]) if torsion else J
            found.append((rows @ by)[:, self.robot.hand_columns])
        return np.array(found)

    def palm(self, q: Array) -> tuple[Array, Array]:
        """Return position (3,) m and rotation (3, 3) of the palm at `q` (n,)."""
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.model, self.data)
        site = self.data.site(self.robot.hand.palm)
        return site.xpos.copy(), site.xmat.reshape(3, 3).copy()

    def clearances(self, q: Array, tips_touch: bool) -> dict[str, float]:
        """Return the least distances, m, of the true collision shapes: hand and arm to object, table, themselves,
        `hand_neighbour` where there are neighbours, and `hand_seen` to the points of a table that was seen.
        """
        self.place(q)
        seen = {} if self._seen is None else {"hand_seen": self._from_seen()}
        return seen | {
            kind: self._least(
                [(a, b) for a, b in pairs if not (tips_touch and a in self._tip_geoms and b in self.object)]
            )
            for kind, pairs in self._pairs.items()
        }

    def over_seen(self, path: Array) -> float:
        """Return the least distance, m, along a path (T, n) from the points of the table that were seen."""
        least = FAR
        for q in densify(path) if self._seen is not None else ():
            self.data.qpos[:] = q
            mujoco.mj_kinematics(self.model, self.data)
            least = min(least, self._from_seen())
        return least

    def _from_seen(self) -> float:
        """Return the least distance, m, of the true shapes from the points of the table that were seen."""
        assert self._seen is not None
        geoms = [g for g, _ in self._pairs["hand_table"]]
        centres, reach = self.data.geom_xpos[geoms], self.model.geom_rbound[geoms]
        least, from_to = FAR, np.zeros(6)
        gaps = np.linalg.norm(self._seen[:, None] - centres, axis=2) - reach
        for point, k in np.argwhere(gaps < least):
            self.data.geom_xpos[self._dot] = self._seen[point]
            apart = mujoco.mj_geomDistance(self.model, self.data, geoms[k], self._dot, FAR, from_to)
            least = min(least, apart + _DOT)
        return least

    @cached_property
    def _pairs(self) -> dict[str, list[tuple[int, int]]]:
        """Geoms that may meet in the simulation, by what they are of."""
        model = self.model
        robot = [
            g
            for g in range(model.ngeom)
            if model.geom_contype[g] and g not in self.object | self.neighbours | {self.table}
        ]
        moving = [g for g in robot if model.body_weldid[model.geom_bodyid[g]] != 0]
        excluded = excluded_pairs(model)
        beside = (
            {"hand_neighbour": [(g, part) for g in moving for part in self.neighbours]}
            if self.neighbours
            else {}
        )
        return beside | {
            "hand_object": [(g, part) for g in moving for part in self.object],
            "hand_table": [(g, self.table) for g in moving if not self._on_plinth(g)],
            "self": [pair for pair in combinations(robot, 2) if self._may_meet(*pair, excluded)],
        }

    def _may_meet(self, a: int, b: int, excluded: set[frozenset[int]]) -> bool:
        """Return True for two geoms that are not of one body, of neighbours, or excluded by the model."""
        model = self.model
        bodies = model.geom_bodyid[[a, b]]
        one, two = model.body_weldid[bodies]
        above = model.body_weldid[model.body_parentid[[one, two]]]
        return one not in (two, above[1]) and two != above[0] and frozenset(bodies.tolist()) not in excluded

    def carried(self, path: Array) -> tuple[float, float]:
        """Return how far, m, the object lies from its neighbours, and how near it comes to them in the hand.

        Args:
            path: (T, n), the first row where the hand takes it; overlaps are negative.
        """
        places = {g: (self.data.geom_xpos[g].copy(), self.data.geom_xmat[g].copy()) for g in self.object}
        pairs, (p, R) = [(g, other) for g in self.object for other in self.neighbours], self.palm(path[0])
        found = []
        for q in path:
            at, now = self.palm(q)
            for g, (centre, axes) in places.items():
                turn = now @ R.T
                self.data.geom_xpos[g] = turn @ (centre - p) + at
                self.data.geom_xmat[g] = (turn @ axes.reshape(3, 3)).ravel()
            found.append(self._least(pairs))
        return found[0], min(found)

    def first_contact(self, path: Array, with_object: bool = True) -> float:
        """Return the deepest penetration, m, where on a path (T, n) anything touches first; else 0."""
        for q in densify(path):
            self.data.qpos[:] = q
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_collision(self.model, self.data)
            depths = [
                -float(c.dist) for c in self.data.contact if self._is_collision(set(c.geom), with_object)
            ]
            if (depth := max(depths, default=0.0)) > 0.0:
                return depth
        return 0.0

    def _is_collision(self, pair: set[int], with_object: bool) -> bool:
        """Object, neighbours and table belong together, and so do the table and what stands on its plinth."""
        if pair <= self.object | self.neighbours | {self.table}:
            return False
        if pair & self.object:
            return with_object
        return self.table not in pair or not any(map(self._on_plinth, pair - {self.table}))

    def _on_plinth(self, geom: int) -> bool:
        # links 0 to 2 stand on the arm's plinth, not over the table
        return self.model.body(self.model.geom_bodyid[geom]).name in self.robot.arm.bodies[:3]

    def _least(self, pairs: list[tuple[int, int]]) -> float:
        from_to = np.zeros(6)
        return min(
            (mujoco.mj_geomDistance(self.model, self.data, a, b, FAR, from_to) for a, b in pairs), default=FAR
        )


def _hull(vertices: Array) -> Any:
    import trimesh

    return trimesh.Trimesh(vertices, process=False).convex_hull


def _bare(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Take away what is only seen: it would cost nine tenths of the compilation."""
    for geom in list(spec.geoms):
        if geom.contype == 0 and geom.conaffinity == 0:
            spec.delete(geom)
    needed = {geom.meshname for geom in spec.geoms}
    for mesh in list(spec.meshes):
        if mesh.name not in needed:
            spec.delete(mesh)
    return spec
