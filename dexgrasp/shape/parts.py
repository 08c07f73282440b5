"""Convex parts of a cloud: where its convex hull holds much air, it is cut by planes until the parts hold little."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dexgrasp.shape.hull import REACH, cloud_corners
from dexgrasp_env.arrays import Array
from dexgrasp_env.perception.plane import Plane

MOST_PARTS = 6
_DEEP = 0.008  # m inside the hull, from where a point counts as deep
_SHARE = 0.05  # of the points that are deep, from where an object is cut at all
_NOTCH = 0.005  # m that a point lies inside the hull of its piece, from where a cut through it is tried
_GAIN = 0.05  # of a piece's volume: what a cut must take away
_LEAST = 0.02  # of the whole's volume: the same
_LEFT = 0.9  # of the hull's volume: parts that hold more stand back for it
_OVERLAP = 0.004  # m that the points of a part reach beyond the cut, so that the parts meet
_POINTS = 300  # that cuts are tried on
_NOTCHES = 3  # deepest points of a piece that cuts are tried through
_APART = 0.03  # m between two of them


def parts_within(hull: Array, points: NDArray[Any], plane: Plane | None) -> list[Array]:
    """Return the corners of convex parts whose union is the object of a cloud, or of its hull alone.

    The deepest notch is cut first (Lien and Amato, Approximate convex decomposition of polyhedra, 2007): through one of
    the points that lie farthest inside the hull, by the plane that takes away most of the volume. The hull
    stays where few points lie deep inside it, as on a convex object, or where little is taken away in all, as from a
    hollow one.

    Args:
        hull: (N, 3) m, its corners as `cloud_corners` finds them.
        points: (M, 3) m, seen all round.
        plane: the table, down to which parts near it are completed; None completes nothing.

    Returns:
        (K, 3) m of each part, at most `MOST_PARTS`.
    """
    points = np.asarray(points, dtype=float)
    pieces = _cut_up(points, plane)
    if len(pieces) < 2:
        return [hull]
    found = [cloud_corners(points[piece.holds(points)], plane) for piece in pieces]
    parts = [part for part in found if part is not None]
    from scipy.spatial import ConvexHull

    little = sum(ConvexHull(part).volume for part in parts) > _LEFT * ConvexHull(hull).volume
    return [hull] if len(parts) < len(found) or little else parts


class _Piece(NamedTuple):
    """What of the cloud lies within half-spaces n . x <= offset, and how much air its hull may hold."""

    points: Array  # (N, 3) m, those that cuts are tried on
    normals: Array  # (K, 3)
    offsets: Array  # (K,) m
    volume: float  # m3, of the points' hull
    planes: Array  # (F, 4) of the hull

    @classmethod
    def of(cls, points: Array, normals: Array, offsets: Array) -> "_Piece | None":
        """Return the piece of these points, or None where they span no volume."""
        from scipy.spatial import ConvexHull, QhullError

        inside = points[_within(points, normals, offsets)]
        if len(inside) < 8:
            return None
        try:
            hull = ConvexHull(inside)
        except QhullError:
            return None
        return cls(inside, normals, offsets, float(hull.volume), hull.equations)

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """Return which of points (M, 3) belong to the piece (M,)."""
        return _within(points, self.normals, self.offsets)

    def depths(self) -> Array:
        """Return how far the points lie inside the hull (N,) m."""
        return np.asarray(-(self.points @ self.planes[:, :3].T + self.planes[:, 3]).max(1))

    def notches(self) -> Array:
        """Return the deepest points (K, 3) inside the hull, apart from each other, deepest first."""
        depth = self.depths()
        found: list[int] = []
        for k in np.argsort(-depth, kind="stable"):
            if depth[k] < _NOTCH or len(found) == _NOTCHES:
                break
            if all(np.linalg.norm(self.points[k] - self.points[j]) > _APART for j in found):
                found.append(int(k))
        return self.points[found]

    def cut(self, normal: Array, offset: float) -> "list[_Piece] | None":
        """Return the two sides of a plane, or None where one is nothing."""
        sides = []
        for sign in (1.0, -1.0):
            normals, offsets = (
                np.vstack([self.normals, sign * normal]),
                np.append(self.offsets, sign * offset),
            )
            side = _Piece.of(self.points, normals, offsets)
            if side is None:
                return None
            sides.append(side)
        return sides


def _within(points: Array, normals: Array, offsets: Array) -> NDArray[np.bool_]:
    """Whether points (M, 3) lie within half-spaces, or next to them (M,)."""
    return np.asarray((points @ normals.T <= offsets + _OVERLAP).all(1))


def _cut_up(points: Array, plane: Plane | None) -> list[_Piece]:
    """Cut the whole, and again the piece whose cut takes away most, until none takes away enough."""
    whole = _Piece.of(_sample(points, plane), np.zeros((0, 3)), np.zeros(0))
    if whole is None or (whole.depths() > _DEEP).mean() < _SHARE:
        return []
    least = _LEAST * whole.volume
    cuts = [(whole, _best_cut(whole, least))]
    while len(cuts) < MOST_PARTS:
        gains = [_gain(piece, sides) for piece, sides in cuts]
        k = int(np.argmax(gains))
        sides = cuts[k][1]
        if sides is None:
            break
        last = len(cuts) + 1 == MOST_PARTS
        cuts[k : k + 1] = [(side, None if last else _best_cut(side, least)) for side in sides]
    return [piece for piece, _ in cuts]


def _gain(piece: _Piece, sides: list[_Piece] | None) -> float:
    return piece.volume - sum(side.volume for side in sides) if sides else 0.0


def _best_cut(piece: _Piece, least: float) -> list[_Piece] | None:
    """Return the sides of the cut that takes away most, None where none takes away `least`, m3, and `_GAIN`."""
    best, least = None, max(least, _GAIN * piece.volume)
    if piece.volume < 2.0 * least:
        return None
    for notch in piece.notches():
        for normal in _DIRECTIONS:
            sides = piece.cut(normal, float(normal @ notch))
            if (gain := _gain(piece, sides)) > least:
                best, least = sides, gain
    return best


def _sample(points: Array, plane: Plane | None) -> Array:
    """Return some of the points, and where those near the table stand on it."""
    some = points[:: max(1, len(points) // _POINTS)]
    if plane is None:
        return some
    heights = plane.heights(some)
    dropped = some - heights[:, None] * plane.normal
    return np.concatenate([some, dropped[heights < REACH]])


def _directions() -> Array:
    turn = np.pi * np.arange(12) / 12
    level = np.stack([np.cos(turn), np.sin(turn), np.zeros(12)], 1)
    return np.concatenate([level, [[0.0, 0.0, 1.0]]])


_DIRECTIONS = _directions()
