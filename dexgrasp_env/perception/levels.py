"""Levels of a cloud: its wide planes, each told from the others by how thin and how connected it is.

A plane that bridges two levels, a table and a plate beside it or the foot of a ramp, holds more points than either as
long as points may be far from it. So a point counts for a level only within the noise that the surfaces themselves
show, and only where what is held hangs together.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from dexgrasp_env.arrays import Array, Index, Mask
from dexgrasp_env.perception.cloud import thinned
from dexgrasp_env.perception.plane import Plane, fit_plane, refine_plane
from dexgrasp_env.poses import placed

CELL = 0.02
"""m, of the grid on which what a level holds hangs together."""
STEEPEST = np.radians(60.0)  # of a level that is looked for, to say its angle
_HALF = 140  # cells, half the side of images of what is 2 m around the base and may lean
_THIN = 0.010  # m, side of cubes of which one point each is judged: a surface counts by its area
_BAND = (0.003, 0.006)  # m within which the middle of a patch is a level's, at least and at most


class Level(NamedTuple):
    """A wide plane of a cloud, and images of cells of the table, seen from above, see `pixels`.

    Attributes:
        plane: through what it holds.
        cells: that hold some of it.
        floor: the same with those that things on it hide.
    """

    plane: Plane
    cells: Mask
    floor: Mask

    @property
    def area(self) -> float:
        """Area that is seen of it, m2."""
        return CELL**2 * float(self.cells.sum())

    def surface(self, cells: Mask) -> Array:
        """Return its points (K, 3) m in the middle of the cells of an image."""
        middles, normal = (cells_in(cells) + 0.5) * CELL, self.plane.normal
        return np.c_[middles, (self.plane.offset - middles @ normal[:2]) / normal[2]]

    def placed(self, T: Array) -> "Level":
        """Return it in a frame in which its own has pose `T` (4, 4)."""
        cells, floor = (drawn(placed(T, self.surface(image))) for image in (self.cells, self.floor))
        return Level(self.plane.placed(T), cells, floor)


def find_levels(points: Array, rng: Generator, off: float) -> list[Level]:
    """Return the wide planes of points (M, 3) m within `off` m of z = 0, the largest first."""
    left, band = _surface(points)
    found = list[Level]()
    for _ in range(6):
        plane = fit_plane(left, rng, off=off, min_inliers=60, tilt=STEEPEST, within=0.5 * band, triples=300)
        if plane is None:
            break
        near = np.abs(plane.heights(left)) < max(band, 3.0 * plane.rms)
        level, held = _connected(left, near, plane, band)
        if level is not None and not any(_is_warp(left[held], one.plane) for one in found):
            found.append(level)
        left = left[~held]
    return sorted(found, key=lambda one: -one.area)


def _surface(points: Array) -> tuple[Array, float]:
    """Return the middles (N, 3) m of flat patches of points (M, 3), an even cover, and how far noise takes them.

    Where two levels meet, a patch of both is thicker than noise: it is left out.
    """
    from dexgrasp_env.perception.kernels import local_planes

    thin, some = points[thinned(points, _THIN)], points[thinned(points, 0.5 * _THIN)]
    middles, normals, residuals = local_planes(thin, some, np.ones(len(some)), 0.022, 8)
    flat = np.abs(normals[:, 2]) > np.cos(STEEPEST)
    if not flat.any():
        return thin, _BAND[1]
    noise = max(float(np.median(residuals[flat])), 1e-4)  # m: of computed clouds, whose tables have none
    return middles[flat & (residuals < 2.0 * noise)], float(np.clip(noise, *_BAND))


def _is_warp(points: Array, plane: Plane) -> bool:
    """Return True for points (M, 3) so near a plane that they are of one surface, which depth cameras bend."""
    return bool(np.percentile(np.abs(plane.heights(points)), 90) < 0.007)


def _connected(points: Array, near: Mask, plane: Plane, band: float) -> tuple[Level | None, Mask]:
    """Return the level of the largest pieces of a plane, None where none is wide, and what it holds (M,)."""
    from scipy.ndimage import binary_closing, binary_fill_holes

    pieces = pieces_of(drawn(points[near]))
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    kept = (sizes >= 0.1 * sizes.max())[pieces]
    held = near.copy()
    held[near] = kept[pixels(points[near])]
    whole = refine_plane(points[held], plane.normal, plane.offset, band, 60)
    largest = np.argwhere(pieces == sizes.argmax())
    if whole is None or np.ptp(largest, axis=0).min() * CELL < 0.14:  # m: faces of objects
        return None, near
    shadow = 4  # cells across that a thing, or its shadow, hides
    floor = binary_fill_holes(binary_closing(kept, np.ones((3, 3)), shadow))
    return Level(whole, kept, floor), held


def choose_level(levels: Sequence[Level], points: Array, meant: Array | None = None) -> Level | None:
    """Return the level that most of what is there stands on; where nothing is, the largest.

    What is level and no wider than objects are, high above a larger level, is an object's top; it stands there too.

    Args:
        levels: of a cloud, the largest first.
        points: (M, 3) m of it.
        meant: (K, 3) m, those of them that are pointed at, which alone count then.
    """
    tables = [one for k, one in enumerate(levels) if not any(_is_top(one, two) for two in levels[:k])]
    if len(tables) < 2:
        return tables[0] if tables else None
    some = points[thinned(points, _THIN)] if meant is None or not len(meant) else meant
    heights = np.array([one.plane.heights(some) for one in tables])
    under = np.array([one.floor[pixels(some)] for one in tables]) & (heights > 0.0)
    gaps = np.where(under, heights, np.inf)
    stands = 0.012  # m above a level from where on what is there stands on it
    free = (np.abs(heights) > stands).all(0) | (meant is not None and len(meant) > 0)
    standing = free & (gaps.min(0) > stands) & (gaps.min(0) < 0.30)
    counts = np.bincount(gaps.argmin(0)[standing], minlength=len(tables))
    level = np.array([one.plane.normal[2] > np.cos(np.radians(3.0)) for one in tables])
    weights = np.where(level, 1.5, 1.0) * (counts if counts.any() else [one.area for one in tables])
    return tables[int(np.argmax(weights))]


def _is_top(one: Level, lower: Level) -> bool:
    """Return True for a level that is the top of an object on a larger one: 5 cm higher, of less than 0.09 m2."""
    rise = (one.surface(one.floor) - lower.surface(one.floor))[:, 2].mean()
    return bool(rise > 0.05 and one.area < 0.09)


def pixels(points: Array) -> tuple[Index, Index]:
    """Return the pixels (M,) of points (M, 2 or 3) m, no farther than a cloud around the base reaches, in images."""
    x, y = np.floor(points[:, :2] / CELL).astype(np.int64).T + _HALF
    return x, y


def drawn(points: Array) -> Mask:
    """Return the image of the cells that points (M, 2 or 3) m are in."""
    image = np.zeros((2 * _HALF, 2 * _HALF), bool)
    image[pixels(points)] = True
    return image


def cells_in(image: Mask) -> Index:
    """Return the cells (K, 2) of an image, row after row."""
    return np.argwhere(image) - _HALF


def pieces_of(cells: Mask) -> Index:
    """Return the image of the number, from 1 on, of the connected piece that each cell is of; 0 for none."""
    from scipy.ndimage import label

    return np.asarray(label(cells, np.ones((3, 3)))[0])
