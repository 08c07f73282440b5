"""The table of a recorded cloud, or the reason why there is none to stand on.

Unlike with simulated cameras nothing is known of the images that the points were made from, and a wrong unit or frame
is likelier than noise. What comes in is in the frame of the robot's base, moved to the world.
"""

from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from dexgrasp_env.arrays import Array
from dexgrasp_env.perception.cloud import (
    MIN_POINTS,
    WORKSPACE_HIGH,
    WORKSPACE_LOW,
    Cloud,
    cells_of,
    crop,
)
from dexgrasp_env.perception.plane import TOLERANCE, Plane, fit_plane
from dexgrasp_env.perception.reasons import (
    EMPTY,
    NO_PLANE,
    TABLE_HEIGHT,
    TILTED,
    UNIT,
    UPSIDE_DOWN,
    NoTargetError,
)
from dexgrasp_env.robot.cell import Cell

_VOXEL = 0.002  # m: denser clouds are thinned to one point a cell
_ROOM = 2.0  # m around the base: what is farther is no business of the arm
_LARGEST = 5.0  # m from the base: beyond, the unit is wrong
_HEIGHTS = 0.30  # m above and below the cell's table where one is looked for, to say where it is
_TABLE_OFF = 0.02  # m that the table may be off the cell's
_TILTED, _LEVELLED = np.radians(3.0), np.radians(20.5)  # of a table that is not level; that is levelled
_STEEPEST = np.radians(60.0)  # of a table that is looked for, to say its angle
_MOST = 1.5  # points that it holds to one that the best level plane does
_UNDER = 0.1  # share of points under it, at most
_BESIDE, _AREA = 0.1, 0.02  # share of a table, and m2 of it, that is seen beside what stands on it
_JUDGED = 5000  # of its points
_WIDE = 0.14  # m, both ways, of a table that is seen
_BELOW = 0.5  # share of the points near the table that lie under it, from where the cloud is upside down


class Support(NamedTuple):
    """A cloud on a level table.

    Attributes:
        cloud: points (M, 3) m, world frame, the table among them.
        plane: the table.
        tilt: rad by which it leaned; 0 where nothing was turned.
        rotation, about: (3, 3) and (3,) m, how the cloud was turned about a point.
    """

    cloud: Cloud
    plane: Plane
    tilt: float
    rotation: Array
    about: Array


def near_base(cloud: Cloud) -> Cloud:
    """Return what is around the base, thinned to one point a voxel, the first of each.

    Raises:
        NoTargetError: for a cloud that is next to empty, or not in metres.
    """
    if len(cloud) < MIN_POINTS:
        raise NoTargetError(EMPTY, f"{len(cloud)} points")
    if np.median(np.abs(cloud.points).max(axis=1)) > _LARGEST:
        raise NoTargetError(UNIT, f"median distance from the base {np.median(np.abs(cloud.points)):.0f}")
    cloud = crop(cloud, (-_ROOM,) * 3, (_ROOM,) * 3)
    _, first = np.unique(cells_of(cloud.points, _VOXEL), return_index=True)
    if len(first) < MIN_POINTS:
        raise NoTargetError(EMPTY, f"{len(first)} points within {_ROOM:g} m of the base")
    return cloud.select(np.sort(first))


def find_support(cloud: Cloud, rng: Generator, cell: Cell) -> Support:
    """Return a cloud with its table level.

    It is turned about the robot's base, as if the frame were off; where the table is then not at its height, about the
    middle of the workspace, as if the table were.

    Raises:
        NoTargetError: where there is no table, or it leans or is off too far.
    """
    from scipy.spatial.transform import Rotation

    leaning = _find_table(cloud, rng)
    tilt = float(np.arccos(min(leaning.normal[2], 1.0)))
    if tilt < _TILTED:
        _check_height(leaning, cell)
        return Support(cloud, leaning, 0.0, np.eye(3), cell.base)
    if tilt > _LEVELLED:
        raise NoTargetError(TILTED, f"{np.degrees(tilt):.0f} degrees")
    R = Rotation.align_vectors([[0.0, 0.0, 1.0]], [leaning.normal])[0].as_matrix()
    middle = 0.5 * (np.array(WORKSPACE_LOW) + WORKSPACE_HIGH)
    middle[2] = (leaning.offset - leaning.normal[:2] @ middle[:2]) / leaning.normal[2]
    height = leaning.offset - leaning.normal @ cell.base
    about = cell.base if abs(height - cell.table_height) < _TABLE_OFF else middle
    turned = cloud.moved((cloud.points - about) @ R.T + about)
    plane = _find_table(turned, rng)
    _check_height(plane, cell)
    return Support(turned, plane, tilt, R, about)


def _find_table(cloud: Cloud, rng: Generator) -> Plane:
    """Return the table, level or not."""
    local = crop(cloud, (*WORKSPACE_LOW[:2], -np.inf), (*WORKSPACE_HIGH[:2], np.inf))
    pool = local if len(local) > MIN_POINTS else cloud
    plane = fit_plane(pool.points, rng, min_inliers=100)
    if plane is None or _below(pool, plane) > _BELOW:
        # A lower table's object may have a top that passes for the table: the largest plane far and wide tells.
        plane = fit_plane(pool.points, rng, off=_HEIGHTS, min_inliers=100)
    leaning = _leaning(pool, 0 if plane is None else plane.inliers)
    if leaning is not None:
        return leaning
    if plane is None:
        raise NoTargetError(NO_PLANE)
    if not _is_wide(pool, plane) or not _reaches_beyond(pool, plane):
        raise NoTargetError(NO_PLANE, "what is level is an object's")
    below = _below(pool, plane)
    if below > _BELOW:
        raise NoTargetError(UPSIDE_DOWN, f"{100 * below:.0f} % of what is off the table")
    return plane


def _check_height(plane: Plane, cell: Cell) -> None:
    if abs(plane.offset) > _TABLE_OFF:
        found = f"found at z = {plane.offset - cell.base[2]:.3f} m, the cell has {cell.table_height:g} m"
        raise NoTargetError(TABLE_HEIGHT, found)


def _leaning(cloud: Cloud, level: int) -> Plane | None:
    """Return a plane that is not level, holds more of a cloud than the best level one, and has nothing under it."""
    if len(cloud) < _MOST * level:
        return None
    plane = fit_plane(cloud.points, np.random.default_rng(0), off=_HEIGHTS, min_inliers=100, tilt=_STEEPEST)
    if plane is None or plane.normal[2] > np.cos(_TILTED) or plane.inliers < _MOST * level:
        return None
    return plane if _is_wide(cloud, plane) and _below(cloud, plane) < _UNDER else None


def _is_wide(cloud: Cloud, plane: Plane) -> bool:
    """Return true where what a plane holds is larger than faces of objects."""
    held = cloud.points[np.abs(plane.heights(cloud.points)) < TOLERANCE, :2]
    return bool(np.ptp(held, axis=0).min() > _WIDE)


def _reaches_beyond(cloud: Cloud, plane: Plane) -> bool:
    """Return true for a plane that is seen beside what stands on it, as a table is, unlike the rim of an underside."""
    from scipy.spatial import cKDTree

    heights = plane.heights(cloud.points)
    level, above = (
        cloud.points[where, :2] for where in (np.abs(heights) < TOLERANCE, heights > 2.0 * TOLERANCE)
    )
    level = level[:: max(1, len(level) // _JUDGED)]
    far = cKDTree(above).query(level, distance_upper_bound=2.0 * TOLERANCE)[0] if len(above) else np.inf
    free = level[np.broadcast_to(far == np.inf, len(level))]
    area = TOLERANCE**2 * len(np.unique(cells_of(free, TOLERANCE)))
    return len(free) > _BESIDE * len(level) and area > _AREA


def _below(cloud: Cloud, plane: Plane) -> float:
    """Return the share of what is off a plane that lies under it; 0 where next to nothing is off it."""
    heights = plane.heights(cloud.points)
    off = heights[np.abs(heights) > 0.015]
    return float((off < 0).mean()) if len(off) >= MIN_POINTS else 0.0
