"""Obstacles of a recorded cloud that are no objects: wide levels beside the table, and what hangs over it.

Both are boxes. What stands on a table is solid down to it; a board over it is not, where the table is seen below.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from dexgrasp_env.arrays import Array, Index, Mask
from dexgrasp_env.perception.levels import CELL, Level, cells_at, over
from dexgrasp_env.perception.neighbourhoods import linked

_LARGE = 0.35  # m, the longer side of a level that is no object's
_HIGH = 0.25  # m above the table, higher than hands reach past: from there on things may hang
_LINKED, _TOUCHES = 0.03, 0.02  # m between points of one thing that hangs, and of it and the robot
_ON_ROBOT = "what hangs where the robot stands is taken for a part of the robot, and is no obstacle"
_AIR = 0.08  # m between what hangs and what is below it
_SIDE, _THICK = (
    0.04,
    0.02,
)  # m of a square of what hangs, and by which squares that are alike differ in height
_SEEN_BELOW = 0.15  # share of squares below which the table is seen
_HIGHER = 0.004  # m above the table that a level in the way is
_FILLED = 0.3  # of a level's usual points that its cells hold
_ALIKE, _MORE = (
    0.004,
    0.003,
)  # m by which rows of a level may differ in height, and boxes reach beyond what is seen


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
    table, boxes, held = levels[0], list[Array](), np.zeros(len(points), bool)
    for one in levels[1:]:
        whole = _reaching(one, points, within)
        if np.ptp(whole.cells, axis=0).max() * CELL > _LARGE and whole.top(whole.cells).max() > _HIGHER:
            boxes += _level_boxes(whole)
            held |= over(whole.cells, points) & (whole.plane.heights(points) < within)
    hangs = _hanging(points, table) & ~held
    if not hangs.any():
        return Obstacles(tuple(boxes), held, "")
    pieces = linked(points[hangs], _LINKED)
    on_robot = np.isin(pieces, pieces[_near(points[hangs], robot)])
    note = _ON_ROBOT if on_robot.any() else ""
    return Obstacles((*boxes, *_hanging_boxes(points[hangs][~on_robot])), held | hangs, note)


def _near(points: Array, robot: Array) -> Mask:
    """Return which points (M, 3) m touch the robot's (K, 3)."""
    from scipy.spatial import cKDTree

    if not len(robot) or not len(points):
        return np.zeros(len(points), bool)
    return np.isfinite(cKDTree(robot).query(points, distance_upper_bound=_TOUCHES)[0])


def _reaching(level: Level, points: Array, within: float) -> Level:
    """Return a level with all that hangs together with it: it was found in the workspace."""
    from scipy.ndimage import label

    near = cells_at(points[np.abs(level.plane.heights(points)) < within])
    near, count = np.unique(near, axis=0, return_counts=True)
    if len(near):  # noise at its rim fills cells but little
        near = near[count > _FILLED * np.median(count)]
    cells = np.unique(np.concatenate([near, level.cells]), axis=0)
    low = cells.min(0)
    grid = np.zeros(np.ptp(cells, axis=0) + 1, bool)
    grid[tuple((cells - low).T)] = True
    pieces = label(grid, np.ones((3, 3)))[0]
    own = np.unique(pieces[tuple((level.cells - low).T)])
    return level._replace(cells=np.argwhere(np.isin(pieces, own)) + low)


def _level_boxes(level: Level) -> Iterator[Array]:
    """Yield boxes from the table up to a level, row by row of its cells, rows that are alike together."""
    tops = level.top(level.cells) + _MORE
    for low, high in _rectangles(level.cells, tops, _ALIKE):
        within = ((level.cells >= low) & (level.cells < high)).all(1)
        yield _box(np.append(low * CELL, 0.0), np.append(high * CELL, tops[within].max()))


def _hanging(points: Array, table: Level) -> Mask:
    """Return which points (M, 3) hang: there is air below them in their square, and around there the table is seen."""
    from scipy.ndimage import binary_erosion, label

    high = points[:, 2] > _HIGH
    if not high.any():
        return high
    squares, row = np.unique(cells_at(points), axis=0, return_inverse=True)
    below, above = np.zeros(len(squares)), np.full(len(squares), np.inf)
    np.maximum.at(below, row[~high], points[~high, 2])
    np.minimum.at(above, row[high], points[high, 2])
    free = np.isfinite(above) & (above - below > _AIR)
    places = tuple((squares - squares.min(0)).T)
    grid = np.zeros(np.ptp(squares, axis=0) + 1, bool)
    grid[places] = free
    piece = label(grid, np.ones((3, 3)))[0][places]
    inner = binary_erosion(grid, np.ones((3, 3)))[places]  # beside what is solid the table is seen as well
    seen = over(table.cells, np.asarray((squares + 0.5) * CELL, np.float64)) & inner
    share = np.bincount(piece, seen) / np.maximum(np.bincount(piece, inner), 1)
    return np.asarray(high & (free & (share > _SEEN_BELOW)[piece])[row])


def _hanging_boxes(points: Array) -> Iterator[Array]:
    """Yield boxes around points (M, 3) m, from the lowest to the highest in squares that are alike."""
    squares, row = np.unique(np.floor(points[:, :2] / _SIDE).astype(np.int64), axis=0, return_inverse=True)
    tops, lows = np.full(len(squares), -np.inf), np.full(len(squares), np.inf)
    np.maximum.at(tops, row, points[:, 2])
    np.minimum.at(lows, row, points[:, 2])
    lows, tops = lows - _MORE, tops + _MORE
    for low, high in _rectangles(squares, tops, _THICK):
        within = ((squares >= low) & (squares < high)).all(1)
        yield _box(np.append(low * _SIDE, lows[within].min()), np.append(high * _SIDE, tops[within].max()))


def _rectangles(cells: Index, tops: Array, alike: float) -> Iterator[tuple[Index, Index]]:
    """Yield rectangles, from (2,) up to (2,), that cover cells (K, 2): runs of rows, joined where they are alike."""
    order = np.lexsort((cells[:, 1], cells[:, 0]))
    cells, tops = cells[order], tops[order]
    new = np.ones(len(cells), bool)
    new[1:] = (np.diff(cells[:, 0]) != 0) | (np.diff(cells[:, 1]) != 1) | (np.abs(np.diff(tops)) > alike)
    starts = np.flatnonzero(new)
    ends = np.append(starts, len(cells))[1:] - 1
    opened = dict[tuple[int, int], tuple[int, int, float]]()  # columns -> first row, last row, height
    for start, end in zip(starts, ends, strict=True):
        (x, y), last, top = cells[start], int(cells[end, 1]), float(tops[start])
        columns = int(y), last
        known = opened.get(columns)
        if known is not None and known[1] == x - 1 and abs(known[2] - top) <= alike:
            opened[columns] = known[0], x, known[2]
            continue
        if known is not None:
            yield np.array([known[0], y]), np.array([known[1] + 1, last + 1])
        opened[columns] = x, x, top
    for (y, last), (first, before, _) in opened.items():
        yield np.array([first, y]), np.array([before + 1, last + 1])


def _box(low: Array, high: Array) -> Array:
    return np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, 8).T
