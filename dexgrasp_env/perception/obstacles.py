"""Obstacles of a recorded cloud that are no objects: wide levels beside the table, and what hangs over it.

Both are boxes. What stands on a table is solid down to it; a board over it is not, where the table is seen below.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from dexgrasp_env.arrays import Array, Index, Mask, box_corners
from dexgrasp_env.perception.levels import CELL, Level, Raster, cells_at, over
from dexgrasp_env.perception.neighbourhoods import gaps_between, linked

_MORE = 0.003  # m that boxes reach beyond what is seen


class Obstacles(NamedTuple):
    """Boxes that are kept clear of besides objects.

    Attributes:
        boxes: their corners (8, 3) m each.
        points: which points of a cloud they stand for (M,).
        note: in words, what is left out; empty where nothing is.
    """

    boxes: tuple[Array, ...]
    points: Mask
    note: str


def find_obstacles(points: Array, levels: Sequence[Level], within: float, robot: Array) -> Obstacles:
    """Return wide levels and what hangs in a cloud on a table.

    Args:
        points: (M, 3) m, world frame, what is not the table's.
        levels: the table first, then the others, world frame.
        within: m from it, points are a level's.
        robot: (K, 3) m, what was taken out as the robot's: what hangs on it, hoses for one, is no obstacle.
    """
    boxes, held, note = list[Array](), np.zeros(len(points), bool), ""
    for one in levels[1:]:
        whole = _reaching(one, points, within)
        tops = whole.top(whole.cells)
        if (
            np.ptp(whole.cells, axis=0).max() * CELL > 0.35 and tops.max() > 0.004
        ):  # m; smaller is an object's
            boxes += _boxes(whole.cells, CELL, np.zeros(len(tops)), tops, 0.004)
            held |= over(whole.cells, points) & (whole.plane.heights(points) < within)
    hangs = _hanging(points, levels[0]) & ~held
    if hangs.any():
        high, pieces = points[hangs], linked(points[hangs], 0.03)
        on_robot = np.isin(pieces, pieces[gaps_between(high, robot, 0.02) < np.inf])
        if on_robot.any():
            note = "what hangs where the robot stands is taken for a part of the robot, and is no obstacle"
        if not on_robot.all():
            square = 0.04  # m, side of the columns of what hangs, which is seen thinly
            cells, lows, tops = _columns(high[~on_robot], square)
            boxes += _boxes(cells, square, lows - _MORE, tops, 0.02)
    return Obstacles(tuple(boxes), held | hangs, note)


def _columns(points: Array, side: float) -> tuple[Index, Array, Array]:
    """Return the cells (K, 2) of points (M, 3) m, and the lowest and highest height in each."""
    cells, row = np.unique(cells_at(points, side), axis=0, return_inverse=True)
    lows, tops = np.full(len(cells), np.inf), np.full(len(cells), -np.inf)
    np.minimum.at(lows, row, points[:, 2])
    np.maximum.at(tops, row, points[:, 2])
    return cells, lows, tops


def _reaching(level: Level, points: Array, within: float) -> Level:
    """Return a level with all that hangs together with it: it was found in the workspace."""
    near = cells_at(points[np.abs(level.plane.heights(points)) < within])
    near, count = np.unique(near, axis=0, return_counts=True)
    if len(near):  # noise at its rim fills cells but little
        near = near[count > 0.3 * np.median(count)]
    raster = Raster.of(np.concatenate([near, level.cells]))
    pieces = raster.pieces()
    return level._replace(cells=raster.cells(np.isin(pieces, raster.at(pieces, level.cells))))


def _hanging(points: Array, table: Level) -> Mask:
    """Return which points (M, 3) hang: there is air below them in their cell, and around there the table is seen."""
    from scipy.ndimage import binary_erosion

    high = points[:, 2] > 0.25  # m: hands reach past lower things
    if not high.any():
        return high
    cells, row = np.unique(cells_at(points), axis=0, return_inverse=True)
    below, above = np.zeros(len(cells)), np.full(len(cells), np.inf)
    np.maximum.at(below, row[~high], points[~high, 2])
    np.minimum.at(above, row[high], points[high, 2])
    free = np.isfinite(above) & (above - below > 0.08)
    if not free.any():
        return free[row]
    raster, piece = Raster.of(cells[free]), np.zeros(len(cells), np.int64)
    piece[free] = raster.at(raster.pieces(), cells[free])
    inner = free.copy()  # beside what is solid the table is seen as well
    inner[free] = raster.at(binary_erosion(raster.image, np.ones((3, 3))), cells[free])
    seen = over(table.cells, np.asarray((cells + 0.5) * CELL, np.float64)) & inner
    share = np.bincount(piece, seen) / np.maximum(np.bincount(piece, inner), 1)
    return np.asarray(high & (free & (share > 0.15)[piece])[row])


def _boxes(cells: Index, side: float, lows: Array, tops: Array, alike: float) -> Iterator[Array]:
    """Yield the corners (8, 3) m of boxes over cells (K, 2) from heights (K,) m to heights: of runs that are as high,
    within `alike` m.
    """
    order = np.lexsort((cells[:, 1], cells[:, 0]))
    cells, lows, tops = cells[order], lows[order], tops[order]
    apart = (np.diff(cells[:, 0]) != 0) | (np.diff(cells[:, 1]) != 1) | (np.abs(np.diff(tops)) > alike)
    for run in np.split(np.arange(len(cells)), np.flatnonzero(apart) + 1):
        low = [*(side * cells[run[0]]), lows[run].min()]
        high = [*(side * (cells[run[-1]] + 1)), tops[run].max() + _MORE]
        yield box_corners(low, high)
