"""The judge's own distances between the geoms of a model: quadratic programmes over half-spaces.

The planner's are MuJoCo's. Of MuJoCo only the places of geoms are taken here.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import daqp
import mujoco
import numpy as np
from scipy.spatial import cKDTree

from dexgrasp_env.arrays import Array, Index, grid
from dexgrasp_env.objects.parts import ContactPart
from dexgrasp_env.robot.hulls import mesh_of, planes_of

FAR = 0.05  # m: distances beyond are not measured
_TOUCH = 1e-7  # m: hulls that are nearer count as overlapping
_CUBE = grid(*[(-1.0, 1.0)] * 3)
_SIDES = np.vstack([np.eye(3), -np.eye(3)])


@dataclass(frozen=True)
class Shape:
    """A convex geom in its own frame: the hull of corners, {x: normals x <= bounds}, grown by a radius.

    Attributes:
        corners: (V, 3) m; none of a plane.
        normals, bounds: (F, 3) unit and (F,) m.
        radius: m.
        extends: (3, k) unit, the directions in which the hull has an extent: a segment in one, a point in none.
    """

    corners: Array
    normals: Array
    bounds: Array
    radius: float = 0.0
    extends: Array = field(default_factory=lambda: np.eye(3))

    @cached_property
    def rows(self) -> tuple[Array, Array]:
        """A (m, k) and b (m,) m such that A u <= b where `extends` u is in the hull."""
        rows = self.normals @ self.extends
        used = rows.any(1)
        return rows[used], self.bounds[used]


class Placed(NamedTuple):
    """A shape where it is."""

    shape: Shape
    position: Array  # (3,) m
    axes: Array  # (3, 3)

    def apart(self, other: "Placed") -> float:
        """Return the distance, m, from another; less than 0 where they overlap.

        How deep they overlap is measured along the normals of their sides: no less than it is.
        """
        grown, between = self.shape.radius + other.shape.radius, None
        if len(self.shape.corners) and len(other.shape.corners):
            between = self._between(other)
        if between is None or between < _TOUCH:
            between = max(self._before(other), other._before(self))
        return between - grown

    def _between(self, other: "Placed") -> float | None:
        """Return the distance, m, of the hulls, None where daqp does not call it solved."""
        way, k = self.position - other.position, self.shape.extends.shape[1]
        ends = np.hstack([self.axes @ self.shape.extends, -other.axes @ other.shape.extends])
        if not ends.size:
            return float(np.linalg.norm(way))
        (rows, most), (more, high) = self.shape.rows, other.shape.rows
        A = np.zeros((len(most) + len(high), ends.shape[1]))
        A[: len(most), :k], A[len(most) :, k:] = rows, more
        H = ends.T @ ends + 1e-7 * np.eye(len(A.T))  # of two bodies that move alike it is singular
        low, sense = np.full(len(A), -1e30), np.zeros(len(A), np.int32)
        x, _, flag, _ = daqp.solve(H, ends.T @ way, A, np.concatenate([most, high]), low, sense)
        return float(np.linalg.norm(way + ends @ x)) if flag == 1 else None

    def _before(self, other: "Placed") -> float:
        """Return how far, m, the other hull lies beyond the side that it lies farthest beyond."""
        if not len(other.shape.corners):
            return -np.inf
        corners = (other.shape.corners @ other.axes.T + other.position - self.position) @ self.axes
        return float(((corners @ self.shape.normals.T).min(0) - self.shape.bounds).max())


_POINT = Shape(np.zeros((1, 3)), _SIDES, np.zeros(6), extends=np.zeros((3, 0)))


def shape_of(model: mujoco.MjModel, geom: int) -> Shape:
    """Return a geom in its own frame.

    Cylinders and ellipsoids are hulls of points on them, grown until nothing stands out: by 0.12 % of a cylinder's
    radius, 0.5 % of an ellipsoid's longest semi-axis.
    """
    size, kind = model.geom_size[geom], mujoco.mjtGeom(int(model.geom_type[geom])).name
    name = kind.removeprefix("mjGEOM_").lower()
    if name == "plane":
        return Shape(np.zeros((0, 3)), _SIDES[2:3], np.zeros(1))
    if name == "box":
        return Shape(size * _CUBE, _SIDES, np.tile(size, 2))
    if name in ("sphere", "capsule"):
        long = np.array([0.0, 0.0, size[1] if name == "capsule" else 0.0])
        extends = np.eye(3)[:, 2 if name == "capsule" else 3 :]
        return Shape(long * _CUBE, _SIDES, np.tile(long, 2), float(size[0]), extends)
    if name == "mesh":
        points = mesh_of(model, geom)[0].astype(float)
        planes = planes_of(points)
        return Shape(points, planes[:, :3], -planes[:, 3])
    part = ContactPart(name, size)
    points = part.surface().vertices
    planes = planes_of(points)
    missing = 1.0 + (planes[:, 3] / part.support(planes[:, :3])).max()
    return Shape(
        points, planes[:, :3], -planes[:, 3], missing * (size[0] if name == "cylinder" else size.max())
    )


class Distances:
    """Distances between the geoms of a model, where its data has them; spheres around geoms come first."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Take model and data; shapes are made when asked for."""
        self._model, self._data = model, data
        self._shapes = dict[int, Shape]()
        self._is_plane = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE

    def apart(self, a: int, b: int) -> float:
        """Return the distance of two geoms, m, as `Placed.apart` has it."""
        return self._placed(a).apart(self._placed(b))

    def least(self, pairs: Index, most: float = FAR) -> float:
        """Return the least distance of pairs (K, 2) of geoms, `most` m if none is nearer."""
        gaps = self._gaps(pairs)
        for k in np.argsort(gaps):
            if gaps[k] >= most:
                break
            most = min(most, self.apart(*pairs[k]))
        return most

    def from_points(self, geoms: Index, points: cKDTree, most: float = FAR) -> float:
        """Return the least distance of geoms (G,) from points, m, `most` m if none is nearer."""
        places, reach = self._data.geom_xpos[geoms], self._model.geom_rbound[geoms]
        gaps = points.query(places)[0] - reach
        for k in np.argsort(gaps):
            if gaps[k] >= most:
                break
            placed = self._placed(geoms[k])
            near = points.data[points.query_ball_point(places[k], reach[k] + most)]
            local = (near - placed.position) @ placed.axes
            # how far each lies beyond the hull's farthest side: no more than the distance
            beyond = (local @ placed.shape.normals.T - placed.shape.bounds).max(1) - placed.shape.radius
            for i in np.argsort(beyond):
                if beyond[i] >= most:
                    break
                most = min(most, Placed(_POINT, near[i], np.eye(3)).apart(placed))
        return float(most)

    def first_overlap(self, pairs: Index, moves: Iterable[None]) -> float:
        """Return how deep, m, pairs (K, 2) overlap where they first do while geoms are moved; 0 if they never do.

        A pair is measured again where the way since could have used up what was between.
        """
        room, before = np.zeros(len(pairs)), self._relative(pairs)
        for _ in moves:
            now = self._relative(pairs)
            (p, R), (p0, R0) = now, before
            turned = np.linalg.norm(R - R0, axis=(1, 2)) / np.sqrt(2.0)  # the longest way of a point 1 m away
            room -= np.linalg.norm(p - p0, axis=1) + turned * self._model.geom_rbound[pairs[:, 1]]
            near = np.flatnonzero(room <= 0.0)
            room[near] = self._gaps(pairs[near])
            for k in near[room[near] <= 0.0]:
                room[k] = self.apart(*pairs[k])
            if (least := room.min(initial=0.0)) < 0.0:
                return float(-least)
            before = now
        return 0.0

    def _placed(self, geom: int) -> Placed:
        if geom not in self._shapes:
            self._shapes[geom] = shape_of(self._model, geom)
        return Placed(
            self._shapes[geom], self._data.geom_xpos[geom], self._data.geom_xmat[geom].reshape(3, 3)
        )

    def _gaps(self, pairs: Index) -> Array:
        """Return the distances (K,) m of the spheres around pairs of geoms, or of the second's from a plane."""
        (a, b), centres, reach = pairs.T, self._data.geom_xpos, self._model.geom_rbound
        way = centres[b] - centres[a]
        over = (way * self._data.geom_xmat[a][:, 2::3]).sum(1)
        return np.where(self._is_plane[a], over, np.linalg.norm(way, axis=1)) - reach[a] - reach[b]

    def _relative(self, pairs: Index) -> tuple[Array, Array]:
        """Return positions (K, 3) m and axes (K, 3, 3) of the second of each pair as the first sees it."""
        (a, b), data = pairs.T, self._data
        inverse = data.geom_xmat[a].reshape(-1, 3, 3).swapaxes(1, 2)
        way = (data.geom_xpos[b] - data.geom_xpos[a])[..., None]
        return (inverse @ way)[..., 0], inverse @ data.geom_xmat[b].reshape(-1, 3, 3)
