"""The table of a recorded cloud, or the reason why there is none to stand on.

Unlike with simulated cameras nothing is known of the images that the points were made from, and a wrong unit or frame
is likelier than noise. What comes in is in the frame of the robot's base, moved to the world.
"""

from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from dexgrasp_env.arrays import Array, Mask, middle
from dexgrasp_env.perception.cloud import (
    MIN_POINTS,
    WORKSPACE_HIGH,
    WORKSPACE_LOW,
    Cloud,
    cells_of,
    crop,
    means_of,
    thinned,
)
from dexgrasp_env.perception.levels import Level, choose_level, find_levels
from dexgrasp_env.perception.plane import TOLERANCE, Plane, refine_plane
from dexgrasp_env.perception.reasons import NoTargetError
from dexgrasp_env.poses import placed
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.table import SeenTable

_ROOM = 2.0  # m around the base: what is farther is no business of the arm
_FEW_SQUARES = 60  # of a table, that will do


class Support(NamedTuple):
    """A cloud on its table.

    Attributes:
        cloud: points (M, 3) m, in the world of `cell`: the table's top is z = 0.
        plane: the table there.
        cell: with the table where it is seen.
        T: (4, 4) of the world in which the cloud came in.
        levels: the table first, then the others.
    """

    cloud: Cloud
    plane: Plane
    cell: Cell
    T: Array
    levels: tuple[Level, ...]


def near_base(cloud: Cloud) -> Cloud:
    """Return what is around the base, thinned to one point a voxel, the first of each.

    Raises:
        NoTargetError: for a cloud that is next to empty, or not in metres.
    """
    if len(cloud) < MIN_POINTS:
        raise NoTargetError("empty_cloud", f"{len(cloud)} points")
    if (median := np.median(np.linalg.norm(cloud.points, axis=1))) > 5.0:  # m
        raise NoTargetError("unit_is_not_metres", f"median distance from the base {median:.0f}")
    cloud = crop(cloud, (-_ROOM,) * 3, (_ROOM,) * 3)
    cloud = cloud.select(thinned(cloud.points, 0.002))
    if len(cloud) < MIN_POINTS:
        raise NoTargetError("empty_cloud", f"{len(cloud)} points within {_ROOM:g} m of the base")
    return cloud


def find_support(cloud: Cloud, rng: Generator, cell: Cell, meant: Mask | None = None) -> Support:
    """Return a cloud on its table, which may be higher or lower than the cell has it, and lean.

    The robot stays where it is, and the world is where the table is: what leans is levelled, with the robot's base.

    Args:
        cloud: in the cell's world, m.
        rng: draws the hypotheses.
        cell: the robot, and where its table is expected.
        meant: (M,) points that are pointed at: the table is what these stand on; None: what most stands on.

    Raises:
        NoTargetError: where there is no table, or it leans or is off too far.
    """
    plane, levels = _find_table(cloud, rng, meant)
    if np.arccos(min(plane.normal[2], 1.0)) > np.radians(20.5):
        raise NoTargetError("table_tilted", f"{np.degrees(np.arccos(plane.normal[2])):.0f} degrees")
    flat = cloud.points[np.abs(plane.heights(cloud.points)) < TOLERANCE]
    offset = float(plane.offset - plane.normal @ cell.base)
    seen = SeenTable(plane.normal, offset, placed(cell.T_base_world, flat[:: len(flat) // 500 + 1]))
    if abs(seen.off(cell.table_height)) > 0.05:  # m: the frame is wrong
        at = cell.table_height + seen.off(cell.table_height)
        raise NoTargetError(
            "table_not_at_base_height", f"found at z = {at:.3f} m, the cell has {cell.table_height:g} m"
        )
    there = cell.seeing(seen)
    T = there.T_world_base @ cell.T_base_world
    level = Plane(np.array([0.0, 0.0, 1.0]), 0.0, plane.rms)
    return Support(
        cloud.moved(placed(T, cloud.points)), level, there, T, tuple(one.placed(T) for one in levels)
    )


def table_around(support: Support, target: Array) -> SeenTable:
    """Return the table around an object, points (N, 3) m, as it is seen there: warps of a camera are smaller there.

    Points are averaged over squares, so that their noise is; none is nearer to what stands on the table than its foot.
    """
    points, heights = support.cloud.points, support.cloud.points[:, 2]
    flat, standing = points[np.abs(heights) < TOLERANCE], points[(heights > TOLERANCE) & (heights < 0.05)]
    squares = _averaged(flat[_away(flat, standing, 0.012)])
    if len(squares) <= _FEW_SQUARES:
        squares = _averaged(flat)
    away = np.linalg.norm(squares[:, :2] - middle(target)[:2], axis=1)
    squares = squares[np.argsort(away, kind="stable")[:500]]  # 20 cm around it where all of the table is seen
    held = squares
    for _ in range(3):
        fit = SeenTable.of(held)
        off = squares @ fit.normal - np.median(held @ fit.normal)
        noise = np.median(np.abs(off)) / 0.6745  # the standard deviation of normal noise
        held = squares[np.abs(off) < np.clip(3.0 * noise, 0.0015, 0.004)]
    return SeenTable.of(np.round(placed(support.cell.T_base_world, held), 5))


def _away(points: Array, others: Array, reach: float) -> Mask:
    """Return which points (M, 3) m have none of others (N, 3) m within `reach` m, seen from above."""
    from dexgrasp_env.perception.kernels import has_near

    if not len(others):
        return np.ones(len(points), bool)
    return ~has_near(points * [1.0, 1.0, 0.0], others * [1.0, 1.0, 0.0], reach, 1)


def _averaged(points: Array) -> Array:
    """Return the means (K, 3) m of the points (M, 3) in each square, of those with enough points if there are such."""
    number, count = np.unique(cells_of(points[:, :2], 0.016), return_inverse=True, return_counts=True)[1:]
    means = means_of(number, points)
    return means[count >= 3] if (count >= 3).sum() > _FEW_SQUARES else means


def _find_table(cloud: Cloud, rng: Generator, meant: Mask | None) -> tuple[Plane, list[Level]]:
    """Return the table, level or not, and the levels of a cloud, its own first."""
    local = crop(cloud, (*WORKSPACE_LOW[:2], -np.inf), (*WORKSPACE_HIGH[:2], np.inf))
    pool = local if len(local) > MIN_POINTS else cloud
    levels = find_levels(pool.points, rng, 0.30)
    level = choose_level(levels, pool.points, None if meant is None else cloud.points[meant])
    if level is None:
        raise NoTargetError(
            "plane_not_found", "what is level is an object's" if len(pool) > MIN_POINTS else ""
        )
    levels = [level, *(one for one in levels if one is not level)]
    others = np.array([np.abs(one.plane.heights(pool.points)) for one in levels[1:]])
    own = np.abs(level.plane.heights(pool.points))
    nearest = pool.points[(own <= others).all(0)] if len(others) else pool.points
    plane = refine_plane(nearest, level.plane.normal, level.plane.offset, min_inliers=100) or level.plane
    if not _reaches_beyond(pool, plane):
        raise NoTargetError("plane_not_found", "what is level is an object's")
    elsewhere = pool.select(np.asarray((others > TOLERANCE).all(0))) if len(others) else pool
    if (below := _below(elsewhere, plane)) > 0.5:
        raise NoTargetError("upside_down", f"{100 * below:.0f} % of what is off the table")
    return plane, levels


def _reaches_beyond(cloud: Cloud, plane: Plane) -> bool:
    """Return true for a plane that is seen beside what stands on it, as a table is, unlike the rim of an underside."""
    heights = plane.heights(cloud.points)
    level, above = (
        cloud.points[where]
        for where in (np.abs(heights) < TOLERANCE, (heights > 2.0 * TOLERANCE) & (heights < 0.08))
    )
    level = level[:: max(1, len(level) // 5000)]
    free = level[_away(level, above, 2.0 * TOLERANCE)]
    area = TOLERANCE**2 * len(thinned(free[:, :2], TOLERANCE))
    return len(free) > 0.1 * len(level) and area > 0.02


def _below(cloud: Cloud, plane: Plane) -> float:
    """Return the share of what is off a plane that lies under it; 0 where next to nothing is off it."""
    heights = plane.heights(cloud.points)
    off = heights[np.abs(heights) > 0.015]
    return float((off < 0).mean()) if len(off) >= MIN_POINTS else 0.0
