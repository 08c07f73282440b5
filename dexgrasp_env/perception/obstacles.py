"""Obstacles of a recorded cloud that are no objects: wide levels beside the table, and what hangs over it.

Both are boxes. What stands on a table is solid down to it; a board over it is not, where the table is seen below.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from dexgrasp_env.arrays import Array, Index, Mask, box_corners
from dexgrasp_env.perception.levels import CELL, Level, cells_in, pieces_of, pixels
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
        cells, tops = cells_in(whole.cells), whole.surface(whole.cells)[:, 2]
        if np.ptp(cells, axis=0).max() * CELL > 0.35 and tops.max() > 0.004:  # m; smaller is an object's
            boxes += _boxes(cells, CELL, np.zeros(len(tops)), tops, 0.004)
            held |= whole.cells[pixels(points)] & (whole.plane.heights(points) < within)
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
    squares = np.floor(points[:, :2] / side).astype(np.int64)
    cells, row = np.unique(squares, axis=0, return_inverse=True)
    lows, tops = np.full(len(cells), np.inf), np.full(len(cells), -np.inf)
    np.minimum.at(lows, row, points[:, 2])
    np.maximum.at(tops, row, points[:, 2])
    return cells, lows, tops


def _reaching(level: Level, points: Array, within: float) -> Level:
    """Return a level with all that hangs together with it: it was found in the workspace."""
    counts = np.zeros(level.cells.shape)
    np.add.at(counts, pixels(points[np.abs(level.plane.heights(points)) < within]), 1)
    near = counts > 0.0
    if near.any():  # noise at its rim fills cells but little
        near = counts > 0.3 * np.median(counts[near])
    pieces = pieces_of(near | level.cells)
    return level._replace(cells=np.isin(pieces, pieces[level.cells]))


def _hanging(points: Array, table: Level) -> Mask:
    """Return which points (M, 3) hang: there is air below them in their cell, and around there the table is seen."""
    from scipy.ndimage import binary_erosion

    high, at = points[:, 2] > 0.25, np.stack(pixels(points))  # m: hands reach past lower things
    below, above = np.zeros(table.cells.shape), np.full(table.cells.shape, np.inf)
    np.maximum.at(below, tuple(at[:, ~high]), points[~high, 2])
    np.minimum.at(above, tuple(at[:, high]), points[high, 2])
    free = np.isfinite(above) & (above - below > 0.08)
    inner = binary_erosion(free, np.ones((3, 3)))  # beside what is solid the table is seen as well
    pieces = pieces_of(free)
    seen, whole = (
        np.bincount(pieces[cells], minlength=pieces.max() + 1) for cells in (table.cells & inner, inner)
    )
    hangs = free & (seen > 0.15 * whole)[pieces]
    return high & hangs[tuple(at)]


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
