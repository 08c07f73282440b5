"""The judge's scene: the robot, the object's parts and the table where MuJoCo's kinematics have them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product
from typing import Any

import mujoco
import numpy as np
from scipy.spatial import cKDTree

from dexgrasp.geometry.mesh_distance import Closest, closest_on_mesh
from dexgrasp.grasp.trajectory import densify
from dexgrasp.grasp.verify.distances import FAR, Distances
from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.locales import with_decimal_points
from dexgrasp_env.poses import inverse, placed, rigid
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.model import colliding_spec, excluded_pairs


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
        spec = colliding_spec(cell)
        named = [(f"object{k}", part) for k, part in enumerate(self.parts)]
        named += [(f"around{k}", _hull(vertices)) for k, vertices in enumerate(neighbours)]
        for name, part in named:
            mesh = spec.add_mesh(name=name)
            mesh.uservert = np.asarray(part.vertices).ravel()
            mesh.userface = np.asarray(part.faces).ravel()
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
            spec.worldbody.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)
        spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
        self.model: mujoco.MjModel = with_decimal_points(spec.compile)
        self.data = mujoco.MjData(self.model)
        self.object = {self.model.geom(f"object{k}").id for k in range(len(self.parts))}
        self.neighbours = {self.model.geom(f"around{k}").id for k in range(len(neighbours))}
        self.table = self.model.geom("table").id
        self._tip_geoms = [self.model.geom(finger.tip).id for finger in self._fingers]
        self._distances = Distances(self.model, self.data)

    @cached_property
    def hull(self) -> Any:
        """The convex hull of all parts."""
        return _hull(np.concatenate([part.vertices for part in self.parts]))

    @cached_property
    def _seen(self) -> cKDTree:
        """The points that were seen of table and surroundings."""
        table = self.cell.table
        assert table is not None
        return cKDTree(placed(self.cell.T_world_base, np.concatenate([table.points, table.around])))

    def place(self, q: Array) -> None:
        """Put the robot at `q` (n,) rad, Jacobians with it."""
        self._move(q)
        mujoco.mj_comPos(self.model, self.data)

    def _move(self, q: Array) -> None:
        """Put the bodies of the robot where they are at `q` (n,) rad."""
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.model, self.data)

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

    def palm(self, q: Array) -> Array:
        """Return the pose (4, 4) of the palm at `q` (n,)."""
        self._move(q)
        site = self.data.site(self.robot.hand.palm)
        return rigid(site.xmat.reshape(3, 3), site.xpos)

    def clearances(self, q: Array, tips_touch: bool) -> dict[str, float]:
        """Return the least distances, m, of the true collision shapes: hand and arm to object, table, themselves,
        `hand_neighbour` where there are neighbours, and `hand_seen` to points that were seen of table and surroundings.
        """
        self._move(q)
        seen = {} if self.cell.table is None else {"hand_seen": self._from_seen(FAR)}
        return seen | {
            kind: self._distances.least(
                pairs[~np.isin(pairs[:, 1], self._tip_geoms)]
                if tips_touch and kind == "hand_object"
                else pairs
            )
            for kind, pairs in self._pairs.items()
        }

    def over_seen(self, path: Array) -> float:
        """Return the least distance, m, along a path (T, n) from the points that were seen, of which there are some."""
        least = FAR
        for q in densify(path):
            self._move(q)
            least = self._from_seen(least)
        return least

    def in_tips(self, q: Array, points: Array) -> float:
        """Return how deep, m, any of points (N, 3) lies in a grasping tip at `q` (n,) rad; 0 where none does."""
        self._move(q)
        return -self._distances.from_points(np.array(self._tip_geoms), cKDTree(points), 0.0)

    def _from_seen(self, most: float) -> float:
        """Return the least distance, m, from the points that were seen, `most` m if none is nearer."""
        return self._distances.from_points(self._pairs["hand_table"][:, 1], self._seen, most)

    @cached_property
    def _pairs(self) -> dict[str, Index]:
        """Geoms (K, 2) that may meet, the robot's second, by what they are of."""
        model, things = self.model, self.object | self.neighbours | {self.table}
        robot = [g for g in range(model.ngeom) if model.geom_contype[g] and g not in things]
        moving = [g for g in robot if model.body_weldid[model.geom_bodyid[g]] != 0]
        excluded = excluded_pairs(model)
        # links 0 to 2 stand on the arm's plinth, not over the table
        plinth = {model.body(name).id for name in self.robot.arm.bodies[:3]}
        pairs = {
            "hand_neighbour": product(self.neighbours, moving),
            "hand_object": product(self.object, moving),
            "hand_table": product([self.table], [g for g in moving if model.geom_bodyid[g] not in plinth]),
            "self": (pair for pair in combinations(robot, 2) if self._may_meet(*pair, excluded)),
        }
        return {kind: _pairs(of) for kind, of in pairs.items() if kind != "hand_neighbour" or self.neighbours}

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
        data = self.data
        places = {g: rigid(data.geom_xmat[g].reshape(3, 3), data.geom_xpos[g]) for g in self.object}
        pairs, back = _pairs(product(self.object, self.neighbours)), inverse(self.palm(path[0]))
        lying = nearest = FAR
        for k, q in enumerate(path):
            motion = self.palm(q) @ back
            for g, place in places.items():
                T = motion @ place
                data.geom_xpos[g], data.geom_xmat[g] = T[:3, 3], T[:3, :3].ravel()
            nearest = self._distances.least(pairs, nearest)
            lying = lying if k else nearest
        return lying, nearest

    def first_contact(self, path: Array, with_object: bool = True) -> float:
        """Return how deep, m, anything lies in anything where on a path (T, n) it first does; else 0."""
        pairs = [of for kind, of in self._pairs.items() if with_object or kind != "hand_object"]
        return self._distances.first_overlap(np.concatenate(pairs), map(self._move, densify(path)))


def _pairs(of: Iterable[tuple[int, int]]) -> Index:
    return np.array(list(of), int).reshape(-1, 2)


def _hull(vertices: Array) -> Any:
    import trimesh

    return trimesh.Trimesh(vertices, process=False).convex_hull
