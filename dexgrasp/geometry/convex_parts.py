"""Convex parts of a cloud: where its convex hull holds much air, it is cut by planes until the parts hold little."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from dexgrasp.geometry.hull import REACH, cloud_corners
from dexgrasp_env.arrays import Array, Mask
from dexgrasp_env.objects.cutting import best_cut, cut_up, held
from dexgrasp_env.perception.plane import Plane
from dexgrasp_env.poses import about_z

MOST_PARTS = 6


def parts_within(
    hull: Array, points: Array, plane: Plane | None, most: int = MOST_PARTS
) -> tuple[list[Array], bool]:
    """Return the corners of convex parts whose union is the object of a cloud, or of its hull alone.

    The deepest notch is cut first (Lien and Amato, Approximate convex decomposition of polyhedra, 2007): through one of
    the points that lie farthest inside the hull, by the plane that takes away most of the volume. The hull
    stays where few points lie deep inside it, as on a convex object, or where little is taken away in all, as from a
    hollow one.

    Args:
        hull: (N, 3) m, its corners as `cloud_corners` finds them.
        points: (M, 3) m, seen all round.
        plane: the table, down to which parts near it are completed; None completes nothing.
        most: parts at most; 1 leaves the hull as it is.

    Returns:
        (K, 3) m of each part, and whether the hull holds air, so that not all of its surface is the object's.
    """
    points = np.asarray(points, dtype=float)
    whole = _Piece.of(_sample(points, plane), np.zeros((0, 4)))
    deep = 0.0 if whole is None else (whole.depths() > 0.008).mean()  # share of points 8 mm inside or more
    if whole is None or deep < 0.05:
        return [hull], bool(deep > 0.02)
    pieces = _cut_up(whole, most)
    if len(pieces) < 2:
        return [hull], True
    found = [cloud_corners(points[_held(points, piece.within)], plane) for piece in pieces]
    parts = [part for part in found if part is not None]
    little = sum(ConvexHull(part).volume for part in parts) > 0.9 * ConvexHull(hull).volume
    return ([hull] if len(parts) < len(found) or little else parts), True


@dataclass(frozen=True, eq=False)
class _Piece:
    """The part of a cloud within half-spaces n . x <= offset, with its hull."""

    points: Array  # (N, 3) m, those that cuts are tried on
    within: Array  # (K, 4) half-spaces: normals and offsets, m
    hull_volume: float  # m3, of the points' hull
    planes: Array  # (F, 4) of the hull

    @classmethod
    def of(cls, points: Array, within: Array) -> "_Piece | None":
        """Return the piece of these points, or None where they span no volume."""
        inside = points[_held(points, within)]
        if len(inside) < 8:
            return None
        try:
            hull = ConvexHull(inside)
        except QhullError:
            return None
        return cls(inside, within, float(hull.volume), hull.equations)

    def depths(self) -> Array:
        """Return how far the points lie inside the hull (N,) m."""
        return -(self.points @ self.planes[:, :3].T + self.planes[:, 3]).max(1)

    def notches(self) -> Array:
        """Return up to three points (K, 3) 5 mm or more inside the hull, 3 cm apart, deepest first."""
        depth = self.depths()
        found: list[int] = []
        for k in np.argsort(-depth, kind="stable"):
            if depth[k] < 0.005 or len(found) == 3:
                break
            if all(np.linalg.norm(self.points[k] - self.points[j]) > 0.03 for j in found):
                found.append(int(k))
        return self.points[found]

    def cut(self, normal: Array, offset: float) -> "list[_Piece]":
        """Return the two sides of a plane; none where one is nothing."""
        halves = (np.vstack([self.within, sign * np.append(normal, offset)]) for sign in (1.0, -1.0))
        sides = [_Piece.of(self.points, half) for half in halves]
        return [side for side in sides if side] if all(sides) else []


def _held(points: Array, within: Array) -> Mask:
    """Return which points (M, 3) lie within half-spaces (K, 4), or 4 mm beyond, so that parts meet (M,)."""
    return np.asarray((points @ within[:, :3].T <= within[:, 3] + 0.004).all(1))


def _cut_up(whole: _Piece, most: int) -> list[_Piece]:
    """Cut the whole, and again the piece whose cut takes away most, until none takes away enough."""

    @cache
    def sides(piece: _Piece) -> Sequence[_Piece]:
        """Return the sides of the cut that takes away most, the piece itself where that is too little."""
        least = max(0.02 * whole.hull_volume, 0.05 * piece.hull_volume)
        if piece.hull_volume < 2.0 * least:
            return [piece]
        found = best_cut(piece, [(n, float(n @ notch)) for notch in piece.notches() for n in _DIRECTIONS])[1]
        return found if piece.hull_volume - held(found) > least else [piece]

    def gains(pieces: list[_Piece]) -> list[float]:
        """Return by how much, m^3, each piece's hull is larger than what was seen to be there."""
        return [piece.hull_volume - held(sides(piece)) for piece in pieces]

    return cut_up([whole], gains, sides, most - 1)


def _sample(points: Array, plane: Plane | None) -> Array:
    """Return some 300 of the points, and where those near the table stand on it."""
    some = points[:: max(1, len(points) // 300)]
    if plane is None:
        return some
    heights = plane.heights(some)
    dropped = some - heights[:, None] * plane.normal
    return np.concatenate([some, dropped[heights < REACH]])


_DIRECTIONS = np.vstack([about_z(np.pi * np.arange(12) / 12)[:, :, 0], [0.0, 0.0, 1.0]])
