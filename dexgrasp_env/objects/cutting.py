"""Cutting by planes, piece by piece, until convex hulls hold little air: of solids and of clouds alike.

Bounded by work, never by time; of two cuts that are as good the first is taken, so that no rounding decides where a
shape has a symmetry, and the pieces are the same on every machine.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Protocol, Self, TypeVar

import numpy as np

from dexgrasp_env.arrays import Array

Plane = tuple[Array, float]
"""Points x with normal . x = offset."""


class Piece(Protocol):
    """Something that planes cut."""

    @property
    def hull_volume(self) -> float:
        """Volume of its convex hull, m3."""

    def cut(self, normal: Array, offset: float) -> Sequence[Self]:
        """Return the pieces on both sides of a plane; fewer than two where there are no two."""


P = TypeVar("P", bound=Piece)


def held(pieces: Iterable[Piece]) -> float:
    """Return the volume of the hulls of all pieces, m3: the less, the better a cut."""
    return sum(piece.hull_volume for piece in pieces)


def best_cut(piece: P, planes: Iterable[Plane]) -> tuple[Plane, Sequence[P]]:
    """Return the plane whose pieces hold least, the first of those alike, and these; the piece itself if none cuts."""
    cuts = [(plane, piece.cut(*plane)) for plane in planes]
    return min(
        (cut for cut in cuts if len(cut[1]) > 1),
        key=lambda cut: rounded(held(cut[1]) / piece.hull_volume),
        default=((np.zeros(3), 0.0), [piece]),
    )


def cut_up(
    pieces: Sequence[P],
    worth: Callable[[list[P]], Sequence[float]],
    cut: Callable[[P], Sequence[P]],
    cuts: int,
) -> list[P]:
    """Cut the piece that is worth it most, and again, at most `cuts` times, until none is worth more than 0.

    What a piece is cut into takes its place.
    """
    pieces = list(pieces)
    for _ in range(cuts):
        values = worth(pieces)
        most = max(values)
        if most <= 0.0:
            break
        at = values.index(most)
        pieces[at : at + 1] = cut(pieces[at])
    return pieces


def rounded(share: float, alike: float = 1e-6) -> int:
    """Return a share as a whole number of steps of `alike`: what differs by less differs by rounding alone."""
    return round(share / alike)
