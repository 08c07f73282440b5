"""The object as a planner knows it: a convex hull in the robot base frame, and assumptions about its mass."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from agents.geometry.convex import ConvexDistance
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError

if TYPE_CHECKING:
    import trimesh

MAX_FACES = 120  # of the hull that is planned on
ASSUMED_DENSITY = 900.0  # kg/m3: nobody weighs the object; common packed goods are lighter
MASS_RANGE = (0.08, 0.65)  # kg, clip of what is assumed


class Spread(NamedTuple):
    """How far a surface may be from where it is believed to be, by direction."""

    directions: Array  # (K, 3) unit, robot base frame
    errors: Array  # (K,) m, mean absolute error of the support in each

    def along(self, normals: Array) -> Array:
        """Return the error (N,) m where the surface's normals are (N, 3): that of the nearest direction."""
        nearest: Array = self.errors[(normals @ self.directions.T).argmax(1)]
        return nearest


@dataclass(frozen=True)
class GraspTarget:
    """What is grasped.

    Attributes:
        hull: watertight convex mesh, robot base frame, m.
        distance: its signed distance.
        centre: (3,) m, centre of mass, taken to be that of the hull's volume unless it is known.
        mass: kg, assumed unless it is known.
        spread: how far the surface may be off where it was guessed; None where it was seen all round.
    """

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
        """Take the convex hull of a mesh in the robot base frame.

        Args:
            mesh: m, robot base frame.
            mass: kg; assumed from the hull's volume if None.
            centre: (3,) m; the hull's centroid if None.
            spread: of a surface that was guessed in part.

        Raises:
            InputError: for a mesh without volume or a mass that is not positive.
        """
        import trimesh

        if mass is not None and not (np.isfinite(mass) and mass > 0.0):
            raise InputError(f"mass {mass!r}: valid is a positive number of kilograms")
        distance = ConvexDistance.from_mesh(mesh, max_faces=MAX_FACES)
        hull = trimesh.Trimesh(
            distance.triangles.reshape(-1, 3), np.arange(3 * len(distance.triangles)).reshape(-1, 3)
        )
        hull.merge_vertices()
        known = assumed_mass(hull) if mass is None else float(mass)
        middle = np.asarray(hull.center_mass if centre is None else centre, dtype=float)
        return cls(hull, distance, middle, known, spread)


def assumed_mass(hull: "trimesh.Trimesh") -> float:
    """Return the mass, kg, that is assumed of an object of which only its hull is known."""
    return float(np.clip(ASSUMED_DENSITY * hull.volume, *MASS_RANGE))
