"""Convex parts of a solid: cut by planes, piece by piece, and pieces merged again where that costs least.

Bounded by work (faces, cuts, parts), never by time, and of two ways that are as good the first is taken, so that no
rounding decides for solids with a symmetry: the parts are the same on every machine.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh

from dexgrasp_env.arrays import Array
from dexgrasp_env.files import Arrays, cached_arrays, content_hash
from dexgrasp_env.objects.model import reduced_hull
from dexgrasp_env.objects.parts import MAX_VERTICES, ContactPart
from dexgrasp_env.objects.repair import closed_gently
from dexgrasp_env.objects.shapes import to_manifold
from dexgrasp_env.objects.surface import simplified

if TYPE_CHECKING:
    import manifold3d

CONVEX = 0.96
"""Share of its convex hull's volume from which a solid counts as convex."""
MOST_PARTS = 24
_VERTICES = 64
_FACES = 1500
_CUTS = 48
_PIECES = 160  # enough: merging takes time with the square of their number, and crumbs are no parts
_EXCESS = 0.02  # of the volume: what the parts' hulls may add before cutting ends
_FREE = 0.002  # of the volume: what a merge may add even where there are few parts already
_OFFSETS = (1 / 6, 1 / 3, 1 / 2, 2 / 3, 5 / 6)  # of a piece's length: where cuts are tried
_GAIN = 0.1  # of a piece's excess: below it no cut helps at once, and the piece is halved
_SECTORS = 12
_ALIKE = 1e-6  # relative: measures of two cuts, merges or axes that differ by less differ by rounding alone
_CRUMB = 1e-9  # of a piece: what a plane through its corners leaves on the wrong side
_VERSION = 5
_LAYOUT = {"points": (None, 3), "counts": (None,)}


def convex_parts(mesh: trimesh.Trimesh) -> tuple[tuple[ContactPart, ...], tuple[str, ...]]:
    """Return the convex parts of a watertight mesh, and one sentence for each thing to know of them.

    A nearly convex mesh is one part. Others are decomposed, cached by content; where that fails, the convex
    hull stands in.
    """
    hull = mesh.convex_hull
    whole = (_part(np.asarray(hull.vertices)),)
    if mesh.volume > CONVEX * hull.volume:
        return whole, ()
    faces = np.asarray(mesh.faces, dtype=np.int64)
    key = content_hash(np.asarray(mesh.vertices, dtype=float), faces, _VERSION)
    found = cached_arrays(f"parts/{key}.npy", _LAYOUT, lambda: _packed(decompose(mesh)))
    if not len(found["counts"]):
        return whole, ("could not be split into convex parts: in contact its convex hull stands in",)
    pieces = np.split(found["points"], np.cumsum(found["counts"])[:-1])
    return tuple(map(_part, pieces)), (f"split into {len(pieces)} convex parts",)


def decompose(mesh: trimesh.Trimesh) -> list[Array]:
    """Return the vertices (n, 3) of at most `MOST_PARTS` convex parts; none if the mesh bounds no solid.

    Cutting starts from the whole and, where that does not end well, also from its sectors about the axis that
    suits best, as a cup or a ring wants; the tighter result counts.
    """
    from tqdm import tqdm

    whole = _Piece(to_manifold(_coarse(mesh)))
    if not whole.volume > 0.0:
        return []
    every = 0.2 if sys.stderr.isatty() else 10.0  # seconds; a log file wants fewer lines
    with tqdm(
        total=2 * _CUTS, desc="convex parts", unit="cut", delay=3.0, mininterval=every, leave=False
    ) as bar:
        tries = [_merged(_cut_up([whole], whole.volume, bar), whole.volume)]
        if _volume(tries[0]) > (1.0 + 5 * _EXCESS) * whole.volume:
            tries.append(_merged(_cut_up(_sectors(whole), whole.volume, bar), whole.volume))
    best = min(tries, key=_volume)
    return [np.asarray(reduced_hull(_points(solid), _VERTICES).vertices) for solid in best]


class _Piece:
    """A connected solid with its convex hull."""

    def __init__(self, solid: manifold3d.Manifold) -> None:
        self.solid, self.hull = solid, solid.hull()
        self.volume, self.hull_volume = float(solid.volume()), float(self.hull.volume())

    @property
    def excess(self) -> float:
        """Volume that the hull adds."""
        return self.hull_volume - self.volume

    def cut(self, normal: Array, offset: float) -> list[_Piece]:
        """Return the connected pieces on both sides of the plane normal . x = offset."""
        sides = self.solid.split_by_plane(normal, float(offset))
        pieces = (_Piece(piece) for side in sides for piece in side.decompose())
        return [piece for piece in pieces if piece.volume > _CRUMB * self.volume]

    @cached_property
    def corners(self) -> Array:
        """(n, 3) vertices of the hull."""
        return _points(self.hull)

    @cached_property
    def axes(self) -> Array:
        """(3, 3) rows: principal axes of the hull's inertia, longest first."""
        moments, directions = np.linalg.eigh(_surface(self.hull).moment_inertia)
        return _settled(directions.T, moments)


@dataclass(frozen=True)
class _Cut:
    """A cut that was tried: where along `normal`, and the pieces it makes."""

    normal: Array
    share: float
    pieces: list[_Piece]

    @property
    def volume(self) -> float:
        """Of the pieces' hulls: the less, the better."""
        return sum(piece.hull_volume for piece in self.pieces)


def _cut_up(pieces: list[_Piece], volume: float, bar: Any) -> list[_Piece]:
    """Cut the piece of the most excess, again and again, until `_EXCESS` is reached or cuts or pieces are enough."""
    pieces = list(pieces)
    for _ in range(_CUTS):
        if len(pieces) > _PIECES:
            break
        worst = max(pieces, key=lambda piece: _rounded(piece.excess / volume))
        if sum(piece.excess for piece in pieces) < _EXCESS * volume or worst.excess < 1e-3 * volume:
            break
        pieces.remove(worst)
        pieces += _best_cut(worst)
        bar.update()
    return pieces


def _best_cut(piece: _Piece) -> list[_Piece]:
    """Return the piece cut in the best of 45 ways, the offset refined; halved where no way helps at once."""
    normals = _directions(piece.axes)
    tries = [_try(piece, normal, share) for normal in normals for share in _OFFSETS]
    best = min(tries, key=lambda cut: _rounded(cut.volume / piece.hull_volume))
    if piece.hull_volume - best.volume < _GAIN * piece.excess:
        halves = [tries[k * len(_OFFSETS) + len(_OFFSETS) // 2] for k in range(3)]
        return min(halves, key=lambda cut: round(cut.volume / piece.hull_volume, 2)).pieces
    for step in (1 / 12, 1 / 24, 1 / 48):
        near = [_try(piece, best.normal, best.share + side * step) for side in (-1, 1)]
        best = min([best, *near], key=lambda cut: _rounded(cut.volume / piece.hull_volume))
    return best.pieces


def _try(piece: _Piece, normal: Array, share: float) -> _Cut:
    reach = piece.corners @ normal
    return _Cut(normal, share, piece.cut(normal, reach.min() + share * np.ptp(reach)))


def _directions(axes: Array) -> Array:
    """Three axes and the six diagonals between them, (9, 3)."""
    a, b, c = axes
    diagonals = np.array([a + b, a - b, a + c, a - c, b + c, b - c]) / np.sqrt(2.0)
    return np.concatenate([axes, diagonals])


def _sectors(whole: _Piece) -> list[_Piece]:
    """Cut into `_SECTORS` sectors about the one of three axes that leaves the least excess."""
    axes, centre = whole.axes, np.array(_surface(whole.hull).center_mass)
    fans = [_fan(whole, axes[k], axes[(k + 1) % 3], centre) for k in range(3)]
    return min(fans, key=lambda pieces: _rounded(sum(piece.excess for piece in pieces) / whole.volume))


def _fan(whole: _Piece, axis: Array, side: Array, centre: Array) -> list[_Piece]:
    pieces = [whole]
    for turn in np.linspace(0.0, np.pi, _SECTORS // 2, endpoint=False):
        normal = np.cos(turn) * side + np.sin(turn) * np.cross(axis, side)
        pieces = [part for piece in pieces for part in piece.cut(normal, float(normal @ centre))]
    return pieces


def _merged(pieces: Sequence[_Piece], volume: float) -> list[manifold3d.Manifold]:
    """Merge the hulls of pieces, the pair first that adds the least, until no more than `MOST_PARTS` are left."""
    import manifold3d

    hulls = {k: piece.hull for k, piece in enumerate(pieces)}
    sizes = {k: piece.hull_volume for k, piece in enumerate(pieces)}

    def join(a: int, b: int) -> tuple[float, manifold3d.Manifold]:
        both = manifold3d.Manifold.batch_hull([hulls[a], hulls[b]])
        return both.volume() - sizes[a] - sizes[b], both

    pairs = {(a, b): join(a, b) for a in hulls for b in range(a)}
    while pairs:
        (a, b), (cost, both) = min(pairs.items(), key=lambda item: _rounded(item[1][0] / volume))
        if len(hulls) <= MOST_PARTS and cost > _FREE * volume:
            break
        new = max(sizes) + 1
        del hulls[a], hulls[b]
        pairs = {pair: kept for pair, kept in pairs.items() if not {a, b} & {*pair}}
        hulls[new], sizes[new] = both, both.volume()
        pairs |= {(new, other): join(new, other) for other in hulls if other != new}
    return list(hulls.values())


def _settled(axes: Array, sizes: Array) -> Array:
    """Return principal axes (3, 3), rows, of which those of equal size are turned as near to x, y, z as they go.

    Their signs are such that the largest component is positive.
    """
    out = np.empty((3, 3))
    group = np.concatenate([[0], np.cumsum(np.abs(np.diff(sizes)) > _ALIKE * np.abs(sizes).max())])
    for k in range(3):
        span = axes[group == group[k]]
        left = span - span @ out[:k].T @ out[:k]  # without the axes that are settled
        near = left.T @ left  # columns: x, y, z as far as they lie in what is left
        out[k] = near[:, np.argmax(np.round(np.diag(near), 6))]
        out[k] /= np.linalg.norm(out[k])
        out[k] *= np.sign(out[k, np.argmax(np.round(np.abs(out[k]), 6))])
    return out


def _rounded(share: float) -> int:
    return round(share / _ALIKE)


def _coarse(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The same solid with about `_FACES` faces, which is as good for parts and several times as fast."""
    if len(mesh.faces) <= _FACES:
        return mesh
    coarse = closed_gently(simplified(mesh, _FACES))
    return coarse[0] if coarse and 0.9 < coarse[0].volume / mesh.volume < 1.1 else mesh


def _volume(solids: Sequence[manifold3d.Manifold]) -> float:
    return float(sum(solid.volume() for solid in solids))


def _points(solid: manifold3d.Manifold) -> Array:
    return np.asarray(solid.to_mesh64().vert_properties, dtype=float)[:, :3]


def _surface(solid: manifold3d.Manifold) -> trimesh.Trimesh:
    return trimesh.Trimesh(_points(solid), np.asarray(solid.to_mesh64().tri_verts, dtype=np.int64))


def _part(points: Array) -> ContactPart:
    return ContactPart("mesh", vertices=np.asarray(reduced_hull(points, MAX_VERTICES).vertices))


def _packed(parts: Sequence[Array]) -> Arrays:
    points = np.concatenate(parts) if parts else np.zeros((0, 3))
    return {"points": points, "counts": np.array([len(part) for part in parts], dtype=np.int64)}
