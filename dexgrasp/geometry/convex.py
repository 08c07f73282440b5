"""Convex polyhedra from points or meshes, simplified on request, and the signed distance to one or to their union."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull, QhullError

from dexgrasp.geometry.convex_kernel import Obstacle, convex_distances
from dexgrasp.geometry.quickhull import extreme_points
from dexgrasp_env.arrays import Array, array
from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import check

if TYPE_CHECKING:
    import trimesh

FLAT = 1e-6
"""A hull thinner than this [m] is refused: its inside has no meaning at the scale of a hand."""


@dataclass(frozen=True, eq=False)
class ConvexDistance:
    """Signed distance to a convex polyhedron, or to a union of several.

    Attributes:
        triangles: (F, 3, 3) corners [m], counter-clockwise seen from outside.
        planes: (F, 4) outward unit normal and offset of each triangle.
        sizes: faces of each part of a union, in order.
    """

    triangles: Array
    planes: Array
    sizes: tuple[int, ...]

    @classmethod
    def from_points(cls, points: ArrayLike, max_faces: int | None = None) -> "ConvexDistance":
        """Build the convex hull of points.

        Args:
            points: (N, 3) points [m].
            max_faces: keep at most this many triangles, at least 20: of the corners those that stick out most. The
                result lies inside the hull of all. None keeps all.

        Raises:
            InputError: fewer than 4 points, not finite, or (nearly) coplanar.
        """
        vertices = check("points of a convex hull", points, array(None, 3))
        if len(vertices) < 4:
            raise InputError(f"points are {len(vertices)}: a convex hull needs 4 or more")
        distance, hull = _hull(vertices)
        if max_faces is None or len(distance.planes) <= max_faces:
            return distance
        corners = vertices[hull.vertices]
        chosen = extreme_points(corners, max_faces // 2 + 2)  # n corners make 2 n - 4 triangles
        return _hull(corners[chosen])[0]

    @classmethod
    def union(cls, parts: Sequence["ConvexDistance"]) -> "ConvexDistance":
        """Return the distance to what at least one of some convex polyhedra holds; one part is returned as it is.

        Faces that lie within another part stay: no point outside is nearest to them.
        """
        return reduce(cls.joined, parts)

    def joined(self, other: "ConvexDistance") -> "ConvexDistance":
        """Return the distance to what this or another holds."""
        triangles = np.concatenate([self.triangles, other.triangles])
        return ConvexDistance(
            triangles, np.concatenate([self.planes, other.planes]), self.sizes + other.sizes
        )

    @cached_property
    def parts(self) -> list[Array]:
        """Triangles (F, 3, 3) of each part."""
        return np.split(self.triangles, np.cumsum(self.sizes)[:-1])

    @cached_property
    def corners(self) -> tuple[Array, ...]:
        """Corners (N, 3) [m] of each part."""
        return tuple(map(_corners, self.parts))

    def volume_centre(self) -> Array:
        """Return the centre of mass (3,) [m] of parts of one density; where they overlap, both count."""
        volumes, centres = map(np.array, zip(*map(volume_and_centre, self.parts), strict=True))
        return centres[0] if len(centres) == 1 else volumes @ centres / volumes.sum()

    def hull_volume(self) -> tuple[float, Array]:
        """Return the volume [m3] of the convex hull of all parts, and its centroid (3,) [m]."""
        return volume_and_centre(
            self.triangles if len(self.sizes) == 1 else np.asarray(self.hull().triangles)
        )

    def hull(self) -> "trimesh.Trimesh":
        """Return the convex hull of all parts."""
        import trimesh

        return trimesh.convex.convex_hull(np.concatenate(self.corners))

    @cached_property
    def obstacle(self) -> Obstacle:
        """The polyhedra as compiled code takes them."""
        return Obstacle(self.triangles, self.planes, np.cumsum([0, *self.sizes], dtype=np.int64))

    def distance(self, points: ArrayLike) -> Array:
        """Return the signed distances (N,) [m] of points (N, 3), negative inside."""
        return self.distance_gradient(points)[0]

    def distance_gradient(self, points: ArrayLike) -> tuple[Array, Array]:
        """Return the signed distances (N,) [m] of points (N, 3) and their unit gradients (N, 3)."""
        queries = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
        gradients = np.empty_like(queries)
        return convex_distances(queries, self.obstacle, gradients), gradients


def _corners(triangles: Array) -> Array:
    """Return the corners (N, 3) [m] of triangles (F, 3, 3), each once."""
    points = triangles.reshape(-1, 3)
    first = np.unique(points, axis=0, return_index=True)[1]
    return points[np.sort(first)]


def _hull(points: Array) -> tuple[ConvexDistance, ConvexHull]:
    """Return the distance to a convex hull, and the hull as Qhull has it (its `vertices` take time).

    The planes are Qhull's, one for all triangles of a merged facet: those of thin triangles would be noise.
    """
    centre = points.mean(axis=0)
    try:
        hull = ConvexHull(points - centre)
    except (QhullError, ValueError):
        raise InputError("points lie in a plane: a convex hull needs points with a volume") from None
    if (-hull.equations[:, 3]).max() < FLAT or 3 * hull.volume < FLAT * hull.area / 2:
        raise InputError(f"points lie in a plane to {FLAT} m: a convex hull needs points with a volume")
    planes = hull.equations.copy()
    planes[:, 3] -= planes[:, :3] @ centre
    return ConvexDistance(_outward(points[hull.simplices], planes), planes, (len(planes),)), hull


def _outward(triangles: Array, planes: Array) -> Array:
    """Return triangles (F, 3, 3) counter-clockwise about the normals of planes (F, 4)."""
    turns = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    inward = (turns * planes[:, :3]).sum(1) < 0.0
    triangles[inward] = triangles[inward, ::-1]
    return triangles


def volume_and_centre(triangles: Array) -> tuple[float, Array]:
    """Return the volume, m3, and its centroid (3,) m, of what closed triangles (F, 3, 3) m enclose.

    By the divergence theorem (Eberly, Polyhedral mass properties, 2002); the triangles are counter-clockwise seen from
    outside. The sums are those of trimesh, to the last bit.
    """
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    sides = np.cross(b - a, c - b)
    first = a + b + c
    second = a**2 + b**2 + a * b + c * first
    volume = (sides[:, 0] * first[:, 0]).sum() / 6.0
    moments = np.ascontiguousarray((sides * second).T).sum(axis=1) / 24.0
    return float(volume), moments / volume
