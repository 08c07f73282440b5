"""Convex parts of a solid: cut by planes, piece by piece, and pieces merged again where that costs least."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh

from dexgrasp_env.arrays import Array, cube_directions, divided, joined
from dexgrasp_env.files import cached_arrays, content_hash
from dexgrasp_env.objects.cutting import Plane, best_cut, cut_up, held, rounded
from dexgrasp_env.objects.model import reduced_hull
from dexgrasp_env.objects.parts import MAX_VERTICES, ContactPart
from dexgrasp_env.objects.repair import closed_gently, simplified
from dexgrasp_env.objects.shapes import to_manifold

if TYPE_CHECKING:
    import manifold3d

MOST_PARTS = 24
_CUTS = 48
_EXCESS = 0.02  # of the volume: what the parts' hulls may add before cutting ends
_SECTORS = 12
_VERSION = 6
_NORMALS = cube_directions()[:12:-1].copy()
"""(13, 3) directions that cuts are tried across: to a cube's faces, edges and corners, one of two that are opposite."""


def convex_parts(mesh: trimesh.Trimesh) -> tuple[tuple[ContactPart, ...], tuple[str, ...]]:
    """Return the convex parts of a watertight mesh, and one sentence for each thing to know of them.

    A nearly convex mesh is one part. Others are decomposed, cached by content; where that fails, the convex
    hull stands in.
    """
    hull = mesh.convex_hull
    whole = (_part(np.asarray(hull.vertices)),)
    if mesh.volume > 0.96 * hull.volume:
        return whole, ()
    key = content_hash(
        np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64), _VERSION
    )
    found = cached_arrays(f"parts/{key}.npy", lambda: joined(decompose(mesh)))
    if not len(found["counts"]):
        return whole, ("could not be split into convex parts: in contact its convex hull stands in",)
    pieces = divided(**found)
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
    hull = trimesh.Trimesh(whole.corners, np.asarray(whole.hull.to_mesh64().tri_verts, dtype=np.int64))
    axes = _frame(hull)
    normals = _NORMALS @ axes
    with tqdm(
        total=2 * _CUTS,
        desc="convex parts",
        unit="cut",
        delay=3.0,
        mininterval=0.2 if sys.stderr.isatty() else 10.0,  # seconds; a log file wants fewer lines
        leave=False,
    ) as bar:
        tries = [_cut_up([whole], normals, whole.volume, bar)]
        if _volume(tries[0]) > (1.0 + 5 * _EXCESS) * whole.volume:
            # Sectors about the one of three axes that leaves the least excess.
            fans = [_fan(whole, axes[k], axes[k - 1], np.array(hull.center_mass)) for k in range(3)]
            sectors = min(
                fans, key=lambda pieces: rounded(sum(piece.excess for piece in pieces) / whole.volume)
            )
            tries.append(_cut_up(sectors, normals, whole.volume, bar))
    return [np.asarray(reduced_hull(_points(solid), 64).vertices) for solid in min(tries, key=_volume)]


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
        return [piece for piece in pieces if piece.volume > 1e-9 * self.volume]  # no rest of rounding

    @cached_property
    def corners(self) -> Array:
        """(n, 3) vertices of the hull."""
        return _points(self.hull)


def _cut_up(pieces: list[_Piece], normals: Array, volume: float, bar: Any) -> list[manifold3d.Manifold]:
    """Cut the piece of the most excess, and again, until `_EXCESS` is reached or it is enough, and merge all pieces."""

    def worth(pieces: list[_Piece]) -> list[float]:
        """Return what cutting each piece would win, 0 for those that are to stay whole."""
        excess = [piece.excess / volume for piece in pieces]
        # Merging takes time with the square of their number, and crumbs are no parts.
        enough = len(pieces) > 160 or sum(excess) < _EXCESS
        return [0.0 if enough or share < 0.001 else rounded(share) for share in excess]

    def cut(piece: _Piece) -> Sequence[_Piece]:
        """Cut a piece where that wins most."""
        bar.update()
        return _best_cut(piece, normals)

    return _merged(cut_up(pieces, worth, cut, _CUTS), volume)


def _best_cut(piece: _Piece, normals: Array) -> Sequence[_Piece]:
    """Return the piece cut in the best of 65 ways, the offset refined; halved across where no way helps at once."""
    (normal, offset), pieces = best_cut(
        piece, [_plane(piece, n, share) for n in normals for share in (1 / 6, 1 / 3, 1 / 2, 2 / 3, 5 / 6)]
    )
    if piece.hull_volume - held(pieces) < 0.1 * piece.excess:  # no cut helps at once
        lengths = [rounded(float(np.ptp(piece.corners @ normal)), 1e-5) for normal in normals]
        return best_cut(piece, [_plane(piece, normals[np.argmax(lengths)], 0.5)])[1]
    reach = float(np.ptp(piece.corners @ normal))
    for step in (reach / 12, reach / 24, reach / 48):
        (_, offset), pieces = best_cut(piece, [(normal, at) for at in (offset, offset - step, offset + step)])
    return pieces


def _plane(piece: _Piece, normal: Array, share: float) -> Plane:
    """Return the plane across a direction (3,) with `share` of the piece's length below it."""
    reach = piece.corners @ normal
    return normal, float(reach.min() + share * np.ptp(reach))


def _frame(hull: trimesh.Trimesh) -> Array:
    """Return the axes (3, 3), rows, that cuts follow: first that of a round body's turns, or the longest."""
    moments, axes = np.linalg.eigh(hull.moment_inertia)
    gaps = [rounded(gap / moments[2]) for gap in np.diff(moments)]
    if not any(gaps):
        return np.eye(3)
    own = axes[:, 2 if gaps[0] < gaps[1] else 0]
    own *= np.sign(own[np.argmax(np.abs(own).round(6))])
    side = np.cross(own, np.eye(3)[np.argmin(np.abs(own).round(6))])
    side /= np.linalg.norm(side)
    return np.array([own, side, np.cross(own, side)])


def _fan(whole: _Piece, axis: Array, side: Array, centre: Array) -> list[_Piece]:
    """Cut into `_SECTORS` sectors about an axis, from a side on."""
    pieces = [whole]
    for turn in np.linspace(0.0, np.pi, _SECTORS // 2, endpoint=False):
        normal = np.cos(turn) * side + np.sin(turn) * np.cross(axis, side)
        pieces = [part for piece in pieces for part in piece.cut(normal, float(normal @ centre))]
    return pieces


def _merged(pieces: Sequence[_Piece], volume: float) -> list[manifold3d.Manifold]:
    """Merge the hulls of pieces, the pair first that adds the least, until no more than `MOST_PARTS` are left."""
    import manifold3d

    hulls = {k: piece.hull for k, piece in enumerate(pieces)}

    def join(a: int, b: int) -> tuple[float, manifold3d.Manifold]:
        """Return the volume that joining two hulls adds, m^3, and their common hull."""
        both = manifold3d.Manifold.batch_hull([hulls[a], hulls[b]])
        return both.volume() - hulls[a].volume() - hulls[b].volume(), both

    pairs = {(a, b): join(a, b) for a in hulls for b in range(a)}
    while pairs:
        (a, b), (cost, both) = min(pairs.items(), key=lambda item: rounded(item[1][0] / volume))
        if len(hulls) <= MOST_PARTS and cost > 0.002 * volume:
            break
        new = max(hulls) + 1
        del hulls[a], hulls[b]
        pairs = {pair: kept for pair, kept in pairs.items() if not {a, b} & {*pair}}
        hulls[new] = both
        pairs |= {(new, other): join(new, other) for other in hulls if other != new}
    return list(hulls.values())


def _coarse(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The same solid with about 1,500 faces, which is as good for parts and several times as fast."""
    most = 1500
    if len(mesh.faces) <= most:
        return mesh
    coarse = closed_gently(simplified(mesh, most))
    return coarse[0] if coarse and 0.9 < coarse[0].volume / mesh.volume < 1.1 else mesh


def _volume(solids: Sequence[manifold3d.Manifold]) -> float:
    return float(sum(solid.volume() for solid in solids))


def _points(solid: manifold3d.Manifold) -> Array:
    return np.asarray(solid.to_mesh64().vert_properties, dtype=float)[:, :3]


def _part(points: Array) -> ContactPart:
    return ContactPart("mesh", vertices=np.asarray(reduced_hull(points, MAX_VERTICES).vertices))
