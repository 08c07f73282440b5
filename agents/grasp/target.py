"""The object as a planner knows it: convex parts in the world frame, and assumptions about its mass."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from agents.geometry.convex import ConvexDistance
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError

if TYPE_CHECKING:
    import trimesh

MAX_FACES = 120  # of the hull that is planned on
PART_FACES = 80  # of each part where there are several
ASSUMED_DENSITY = 900.0  # kg/m3: nobody weighs the object; common packed goods are lighter
MASS_RANGE = (0.08, 0.65)  # kg, clip of what is assumed


class Spread(NamedTuple):
    """How far a surface may be from where it is believed to be, by direction."""

    directions: Array  # (K, 3) unit, world frame
    errors: Array  # (K,) m, mean absolute error of the support in each

    def along(self, normals: Array) -> Array:
        """Return the error (N,) m where the surface's normals are (N, 3): that of the nearest direction."""
        nearest: Array = self.errors[(normals @ self.directions.T).argmax(1)]
        return nearest


@dataclass(frozen=True)
class GraspTarget:
    """What is grasped: a union of convex parts, mostly one.

    Attributes:
        parts: watertight convex meshes, world frame, m.
        hull: the convex hull of them all; the part itself where there is one.
        distance: signed distance to their union.
        centre: (3,) m, centre of mass, taken to be that of the parts' volumes unless it is known.
        mass: kg, assumed unless it is known.
        spread: how far the surface may be off where it was guessed; None where it was seen all round.
    """

    parts: "tuple[trimesh.Trimesh, ...]"
    hull: "trimesh.Trimesh"
    distance: ConvexDistance
    centre: Array
    mass: float
    spread: Spread | None = None

    @classmethod
    def of(
        cls,
        mesh: "trimesh.Trimesh",
        mass: float | None = None,
        centre: Array | None = None,
        spread: Spread | None = None,
    ) -> "GraspTarget":
        """Take the convex hull of a mesh in the world frame.

        Args:
            mesh: m, world frame.
            mass: kg; assumed from the hull's volume if None.
            centre: (3,) m; the hull's centroid if None.
            spread: of a surface that was guessed in part.

        Raises:
            InputError: for a mesh without volume or a mass that is not positive.
        """
        return cls.of_parts([mesh], mass, centre, spread)

    @classmethod
    def of_parts(
        cls,
        meshes: "Sequence[trimesh.Trimesh]",
        mass: float | None = None,
        centre: Array | None = None,
        spread: Spread | None = None,
    ) -> "GraspTarget":
        """Take the union of the convex hulls of meshes in the world frame; arguments and errors as in `of`."""
        if mass is not None and not (np.isfinite(mass) and mass > 0.0):
            raise InputError(f"mass {mass!r}: valid is a positive number of kilograms")
        faces = MAX_FACES if len(meshes) == 1 else PART_FACES
        distances = [ConvexDistance.from_mesh(mesh, max_faces=faces) for mesh in meshes]
        parts = tuple(_mesh(distance) for distance in distances)
        hull = parts[0] if len(parts) == 1 else hull_of(parts)
        known = assumed_mass(hull) if mass is None else float(mass)
        middle = np.asarray(volume_centre(parts) if centre is None else centre, dtype=float)
        return cls(parts, hull, ConvexDistance.union(distances), middle, known, spread)

    @property
    def surface(self) -> "trimesh.Trimesh":
        """The faces of all parts in one mesh, also those that lie within another part."""
        import trimesh

        if len(self.parts) == 1:
            return self.hull
        return cast("trimesh.Trimesh", trimesh.util.concatenate(list(self.parts)))


def _mesh(distance: ConvexDistance) -> "trimesh.Trimesh":
    import trimesh

    corners = distance.triangles.reshape(-1, 3)
    mesh = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3))
    mesh.merge_vertices()
    return mesh


def hull_of(parts: "Sequence[trimesh.Trimesh]") -> "trimesh.Trimesh":
    """Return the convex hull of parts."""
    import trimesh

    return trimesh.convex.convex_hull(np.concatenate([part.vertices for part in parts]))


def volume_centre(parts: "Sequence[trimesh.Trimesh]") -> Array:
    """Return the centre of mass (3,) m of parts of one density; where they overlap, both count."""
    volumes = np.array([part.volume for part in parts])
    centres = np.array([part.center_mass for part in parts])
    return centres[0] if len(parts) == 1 else volumes @ centres / volumes.sum()


def assumed_mass(hull: "trimesh.Trimesh") -> float:
    """Return the mass, kg, that is assumed of an object from its hull.

    Also where parts are known: what fills little of its hull is seldom packed goods, and denser.
    """
    return float(np.clip(ASSUMED_DENSITY * hull.volume, *MASS_RANGE))
