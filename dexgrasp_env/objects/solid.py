"""The surface of an object as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True, eq=False)
class Solid:
    """A watertight surface with its convex hull, metres; its trimesh is made when asked for, as the import takes long.

    Attributes:
        vertices: (N, 3).
        faces: (F, 3) indices of vertices.
        corners: (K, 3) of the convex hull.
        hull_centre: (3,) centroid of the hull's volume.
    """

    vertices: Array
    faces: NDArray[np.int64]
    corners: Array
    hull_centre: Array

    @classmethod
    def of(cls, mesh: trimesh.Trimesh) -> Solid:
        """Take a watertight mesh."""
        hull = mesh.convex_hull
        return cls(
            np.array(mesh.vertices, dtype=float), np.array(mesh.faces, dtype=np.int64),
            np.array(hull.vertices, dtype=float), np.array(hull.center_mass),
        )  # fmt: skip

    @cached_property
    def mesh(self) -> trimesh.Trimesh:
        """The surface as a triangle mesh."""
        import trimesh

        return trimesh.Trimesh(self.vertices, self.faces, process=False)

    def scaled(self, factor: float) -> Solid:
        """Return the surface scaled about the origin."""
        return Solid(factor * self.vertices, self.faces, factor * self.corners, factor * self.hull_centre)
