"""The object as a planner knows it: convex parts in the world frame, and assumptions about its mass."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.geometry.hull import REACH
from dexgrasp.geometry.request import ANYHOW, Demand
from dexgrasp.geometry.surface_samples import lattice
from dexgrasp.geometry.walls import walls_of
from dexgrasp_env.arrays import Array, Mask
from dexgrasp_env.errors import InputError
from dexgrasp_env.scene.constants import GRAVITY
from dexgrasp_env.valid import POSITIVE, check

if TYPE_CHECKING:
    import trimesh

PART_FACES = 80  # of each part where there are several


Parts = tuple[Array, ...]
"""Corners (N, 3) m of convex parts of one thing."""


class Uncertainty(NamedTuple):
    """Expected error of a surface that was guessed, by direction."""

    directions: Array  # (K, 3) unit, world frame
    errors: Array  # (K,) m, mean absolute error of the support in each

    def along(self, normals: Array) -> Array:
        """Return the error (N,) m where the surface's normals are (N, 3): that of the nearest direction."""
        return self.errors[(normals @ self.directions.T).argmax(1)]


@dataclass(frozen=True)
class GraspTarget:
    """The object to grasp: a union of convex parts, mostly one.

    The meshes are made when asked for: planning does without, and the import of trimesh takes as long as three plans.

    Attributes:
        distance: signed distance to the union of the parts, world frame, m.
        centre: (3,) m, centre of mass, taken to be that of the parts' volumes unless it is known.
        mass: kg, assumed unless it is known.
        uncertainty: how far the surface may be off where it was guessed; None where it was seen all round.
        neighbours: what stands around it and must not be touched.
        seen: (N, 3) m, points of its surface, where the parts hold air: a cup's mouth is none. None where all of their
            surface is the object's, as far as is known.
        demand: what is asked of its grasp.
        near: the least that the object may be, where `distance` completes a side that no camera saw, farther out; None
            where nothing was guessed.
    """

    distance: ConvexDistance
    centre: Array
    mass: float
    uncertainty: Uncertainty | None = None
    neighbours: tuple[Parts, ...] = ()
    seen: Array | None = None
    demand: Demand = field(default_factory=lambda: Demand(ANYHOW, np.eye(4)))
    near: ConvexDistance | None = None

    @classmethod
    def of(
        cls, *meshes: "trimesh.Trimesh", mass: float | None = None, centre: Array | None = None
    ) -> "GraspTarget":
        """Take the union of the convex hulls of meshes, m, in the world frame; the rest as in `of_corners`."""
        return cls.of_corners([mesh.vertices for mesh in meshes], mass, centre)

    @classmethod
    def of_corners(
        cls,
        corners: Sequence[ArrayLike],
        mass: float | None = None,
        centre: Array | None = None,
        uncertainty: Uncertainty | None = None,
    ) -> "GraspTarget":
        """Take the union of the convex hulls of points in the world frame.

        Args:
            corners: (N, 3) m of each part.
            mass: kg; assumed from the hull's volume if None.
            centre: (3,) m; the centroid of the parts' volumes if None.
            uncertainty: of a surface that was guessed in part.

        Raises:
            InputError: for a part without volume or a mass that is not positive.
        """
        if mass is not None:
            check("mass", mass, POSITIVE)
        faces = 120 if len(corners) == 1 else PART_FACES  # of the hull that is planned on
        distance = ConvexDistance.union([ConvexDistance.from_points(some, faces) for some in corners])
        middle = np.asarray(distance.volume_centre() if centre is None else centre, dtype=float)
        known = assumed_mass(distance.hull_volume()[0]) if mass is None else float(mass)
        return cls(distance, middle, known, uncertainty)

    @property
    def weight(self) -> Array:
        """The force of gravity (3,) N."""
        return np.array([0.0, 0.0, -GRAVITY * self.mass])

    @property
    def known_mass(self) -> float | None:
        """The mass, kg, where it is another than is assumed of the shape."""
        known = abs(self.mass - assumed_mass(self.distance.hull_volume()[0])) > 1e-9
        return self.mass if known else None

    @property
    def is_convex(self) -> bool:
        """True where there is but one part."""
        return len(self.distance.parts) == 1

    def guessed(self, normals: Array) -> float:
        """Return the largest error, m, expected of surfaces with normals (N, 3); 0 where all sides were seen."""
        return 0.0 if self.uncertainty is None else float(self.uncertainty.along(normals).max())

    def gap(self, contacts: Array) -> float:
        """Return how far, m, the surface may lie behind contacts (N, 3) m, where its nearest guess is true."""
        return 0.0 if self.near is None else max(0.0, float(self.near.distance(contacts).max()))

    def was_seen(self, points: Array) -> Mask:
        """Return which points (..., 3) m of the parts' surface lie where the object was seen to be (...).

        Near the table little is seen: below `REACH` height does not count.
        """
        if self.seen is None:
            return np.ones(points.shape[:-1], bool)
        # m from what was seen, beyond which a point of the hull lies on air
        return self._seen_tree.query(_raised(points))[0] < 0.010

    @property
    def narrowed(self) -> bool:
        """True where contacts or palm may not be anywhere: proposals that know nothing of that are mostly lost."""
        asked = self.demand.request
        return bool(asked.hold or asked.avoid or asked.approach)

    @cached_property
    def barred(self) -> cKDTree:
        """Points of the parts' surface that may not be touched, or hardly: the judge's points lie between them."""
        points = lattice(self.distance.triangles, 0.002) if self.narrowed else np.empty((0, 3))
        return cKDTree(points[self.demand.outside(points) > -0.0012])

    @cached_property
    def barred_groups(self) -> tuple[Array, Array]:
        """The same points (G, 32, 3) m in groups of neighbours, and spheres (G, 4) m around those."""
        tree = self.barred
        order = np.append(tree.indices, np.repeat(tree.indices[-1:], -tree.n % 32))
        points = tree.data[order].reshape(-1, 32, 3)
        middles = points.mean(1)
        reach = np.linalg.norm(points - middles[:, None], axis=2).max(1, initial=0.0)
        return points, np.column_stack([middles, reach])

    @cached_property
    def _seen_tree(self) -> cKDTree:
        return cKDTree(_raised(cast("Array", self.seen)))

    @cached_property
    def top(self) -> float:
        """Height of the highest point above the table, m."""
        return float(self.distance.triangles[:, :, 2].max())

    @cached_property
    def around(self) -> ConvexDistance | None:
        """Signed distance to the union of the neighbours, m; None where there is none."""
        parts = [ConvexDistance.from_points(part, PART_FACES) for parts in self.neighbours for part in parts]
        return ConvexDistance.union(parts) if parts else None

    @cached_property
    def everything(self) -> ConvexDistance:
        """Signed distance to the object and its neighbours, m: what a hand that is not grasping keeps clear of."""
        return self.distance if self.around is None else self.distance.joined(self.around)

    @cached_property
    def corners(self) -> Array:
        """Corners (N, 3) m of all parts."""
        return np.concatenate(self.distance.corners)

    @cached_property
    def parts(self) -> "tuple[trimesh.Trimesh, ...]":
        """Watertight convex meshes, world frame, m."""
        return tuple(map(_mesh, self.distance.parts))

    @cached_property
    def hull(self) -> "trimesh.Trimesh":
        """The convex hull of all parts; the part itself where there is one."""
        return self.parts[0] if self.is_convex else self.distance.hull()

    def opened(self) -> "GraspTarget | None":
        """Return the object as the walls that were seen of it, for fingers that go inside; None if it holds no air."""
        parts = []
        for corners in () if self.seen is None else walls_of(self.seen):
            with suppress(InputError):  # points of a part that lie in a plane
                parts.append(ConvexDistance.from_points(corners, PART_FACES))
        if not parts:
            return None
        walls = ConvexDistance.union(parts)
        mass = self.known_mass or assumed_mass(walls.hull_volume()[0])
        return replace(self, distance=walls, centre=walls.volume_centre(), mass=mass)


def _raised(points: Array) -> Array:
    """Return points (..., 3) m with those below `REACH` at it."""
    return np.concatenate([points[..., :2], np.maximum(points[..., 2:], REACH)], axis=-1)


def _mesh(triangles: Array) -> "trimesh.Trimesh":
    import trimesh

    return trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles))


def assumed_mass(volume: float) -> float:
    """Return the mass, kg, that is assumed of an object from the volume of its hull, m3.

    Also where parts are known: what fills little of its hull is seldom packed goods, and denser.
    """
    # kg/m3: nobody weighs the object; common packed goods are lighter
    return float(np.clip(900.0 * volume, 0.08, 0.65))
