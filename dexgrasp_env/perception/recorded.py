"""One object out of the cloud of a whole scene, or the reason why there is none.

For clouds that come from a file or from a user's own cameras: unlike in `segment`, nothing is known of the images they
were made from, and a wrong unit or frame is likelier than noise. What comes in, and what is said of it, is in the frame
of the robot's base; what goes out is in the world's.
"""

from dataclasses import replace

import numpy as np
from numpy.random import Generator

from dexgrasp_env.arrays import Array, middle
from dexgrasp_env.perception.cloud import Cloud, cells_of, crop, inside
from dexgrasp_env.perception.instances import parted
from dexgrasp_env.perception.plane import TOLERANCE, Plane, fit_plane
from dexgrasp_env.perception.pointing import Pointing
from dexgrasp_env.perception.robot import Own
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.perception.segment import (
    COUNT,
    CROP_HIGH,
    CROP_LOW,
    MIN_POINTS,
    SIGMAS,
    divided,
    in_words,
    isolate,
    object_cloud,
    objects_of,
)
from dexgrasp_env.robot.cell import Cell

EMPTY = "empty_cloud"
UNIT = "unit_is_not_metres"
NO_TABLE = "plane_not_found"
UPSIDE_DOWN = "upside_down"
TILTED = "table_tilted"
TABLE_HEIGHT = "table_not_at_base_height"
NO_OBJECT = "no_object_on_the_table"
NOTHING_NEAR = "nothing_near_the_point"
NOTHING_MARKED = "nothing_marked"
SEVERAL = "several_objects"
OUT_OF_REACH = "out_of_reach"

WORDS = {
    EMPTY: "the cloud holds too few points to be a scene",
    UNIT: "the coordinates are too large for metres: millimetres? scale them by 0.001, or say --unit mm",
    NO_TABLE: "no level plane that could be the table: is the cloud in the robot base frame, z up?",
    UPSIDE_DOWN: "the points lie below the table: z must point up in the robot base frame",
    TILTED: "the table is tilted in the frame of the robot's base too far to be levelled: is the cloud in that frame?",
    TABLE_HEIGHT: "the table is not at the height above the robot's base that the cell has it at (table_height)",
    NO_OBJECT: "nothing stands on the table within the workspace",
    NOTHING_NEAR: "no object near the point that was named",
    NOTHING_MARKED: "nothing that stands on the table is in the box or the mask",
    SEVERAL: "several objects are in the workspace: point at the one that is meant by a point near it, a box or a mask",
    OUT_OF_REACH: "the object stands outside the workspace of the arm",
}
"""Reason -> what it means and what to do."""

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
_AROUND = 0.25  # m beyond the workspace within which things stand in the way
_NEAR = 0.08  # m from the named point to the object


class _NoObjectError(Exception):
    """There is no object: a key of `WORDS`, and figures."""


def find_object(
    cloud: Cloud, rng: Generator, cell: Cell, *, pointing: Pointing | None = None, own: Own | None = None
) -> Scene:
    """Return the scene of a cloud: the object that is meant, and what stands around it.

    Args:
        cloud: points in the frame of the robot's base, m; robot and table may be in it.
        rng: draws the plane hypotheses and the subset.
        cell: where the table and the robot's base are.
        pointing: at the object that is meant, in the frame of the base; None takes the only one in the workspace.
        own: tells the robot's points, see `RobotShape.at`; None removes none.

    Returns:
        The scene in the world, or why there is no object: a key of `WORDS`; all that are seen are neighbours then.

    Raises:
        InputError: for a mask that is not the cloud's.
    """
    pointing, objects = (pointing or Pointing()).moved(cell.base), list[tuple[Cloud, bool]]()
    pointing.marks(cloud)  # a mask of something else is a mistake whatever the cloud shows
    try:
        cloud = _in_metres(cloud)
        cloud = cloud.moved(cloud.points + cell.base)
        cloud, pointing, plane, tilt = _levelled(cloud, pointing, rng, cell)
        above = isolate(cloud, plane, max(0.004, SIGMAS * plane.rms), own)
        above = crop(above, np.array(CROP_LOW) - _AROUND, np.array(CROP_HIGH) + _AROUND)
        parting = parted(above, plane)
        numbers = objects_of(above, parting)
        objects = [(above.select(parting.labels == k), bool(parting.doubtful[k])) for k in numbers]
        if (marked := pointing.marks(above)) is not None:
            parting, number = parting.with_marked(marked)
            found = above.select(marked)
            if len(found) < MIN_POINTS:
                raise _NoObjectError(NOTHING_MARKED, f"{len(found)} points")
            if not _in_reach(found):
                raise _NoObjectError(OUT_OF_REACH, _places([found], cell.base))
        else:
            number = numbers[_choose([one for one, _ in objects], len(above), pointing.near, cell.base)]
    except _NoObjectError as refused:
        reason, detail = refused.args
        words = WORDS[reason]
        seen = tuple(
            object_cloud(one, None, COUNT, doubtful, cameras_known=False) for one, doubtful in objects
        )
        return Scene(reason=reason, sentence=f"{words} ({detail})" if detail else words, neighbours=seen)
    return replace(divided(above, parting, number, plane, rng, cameras_known=False), tilt=tilt)


def _in_metres(cloud: Cloud) -> Cloud:
    """Return what is around the base, thinned to one point a voxel, the first of each."""
    if len(cloud) < MIN_POINTS:
        raise _NoObjectError(EMPTY, f"{len(cloud)} points")
    if np.median(np.abs(cloud.points).max(axis=1)) > _LARGEST:
        raise _NoObjectError(UNIT, f"median distance from the base {np.median(np.abs(cloud.points)):.0f}")
    cloud = crop(cloud, (-_ROOM,) * 3, (_ROOM,) * 3)
    _, first = np.unique(cells_of(cloud.points, _VOXEL), return_index=True)
    if len(first) < MIN_POINTS:
        raise _NoObjectError(EMPTY, f"{len(first)} points within {_ROOM:g} m of the base")
    return cloud.select(np.sort(first))


def _levelled(
    cloud: Cloud, pointing: Pointing, rng: Generator, cell: Cell
) -> tuple[Cloud, Pointing, Plane, float]:
    """Return a cloud with its table level, what is pointed at in it, the table, and how far, rad, it was tilted.

    It is turned about the robot's base, as if the frame were off; where the table is then not at its height, about the
    middle of the workspace, as if the table were.
    """
    from scipy.spatial.transform import Rotation

    leaning = _find_table(cloud, rng)
    tilt = float(np.arccos(min(leaning.normal[2], 1.0)))
    if tilt < _TILTED:
        _check_height(leaning, cell)
        return cloud, pointing, leaning, 0.0
    if tilt > _LEVELLED:
        raise _NoObjectError(TILTED, f"{np.degrees(tilt):.0f} degrees")
    R = Rotation.align_vectors([[0.0, 0.0, 1.0]], [leaning.normal])[0].as_matrix()
    middle = 0.5 * (np.array(CROP_LOW) + CROP_HIGH)
    middle[2] = (leaning.offset - leaning.normal[:2] @ middle[:2]) / leaning.normal[2]
    height = leaning.offset - leaning.normal @ cell.base
    about = cell.base if abs(height - cell.table_height) < _TABLE_OFF else middle
    turned = cloud.moved((cloud.points - about) @ R.T + about)
    plane = _find_table(turned, rng)
    _check_height(plane, cell)
    return turned, pointing.turned(cloud, R, about), plane, tilt


def _find_table(cloud: Cloud, rng: Generator) -> Plane:
    """Return the table, level or not."""
    local = crop(cloud, (*CROP_LOW[:2], -np.inf), (*CROP_HIGH[:2], np.inf))
    pool = local if len(local) > MIN_POINTS else cloud
    plane = fit_plane(pool.points, rng, min_inliers=100)
    if plane is None or _below(pool, plane) > _BELOW:
        # A lower table's object may have a top that passes for the table: the largest plane far and wide tells.
        plane = fit_plane(pool.points, rng, off=_HEIGHTS, min_inliers=100)
    leaning = _leaning(pool, 0 if plane is None else plane.inliers)
    if leaning is not None:
        return leaning
    if plane is None:
        raise _NoObjectError(NO_TABLE, "")
    if not _is_wide(pool, plane) or not _reaches_beyond(pool, plane):
        raise _NoObjectError(NO_TABLE, "what is level is an object's")
    below = _below(pool, plane)
    if below > _BELOW:
        raise _NoObjectError(UPSIDE_DOWN, f"{100 * below:.0f} % of what is off the table")
    return plane


def _check_height(plane: Plane, cell: Cell) -> None:
    if abs(plane.offset) > _TABLE_OFF:
        found = f"found at z = {plane.offset - cell.base[2]:.3f} m, the cell has {cell.table_height:g} m"
        raise _NoObjectError(TABLE_HEIGHT, found)


def _leaning(cloud: Cloud, level: int) -> Plane | None:
    """Return a plane that is not level, holds more of a cloud than the best level one, and has nothing under it."""
    if len(cloud) < _MOST * level:
        return None
    plane = fit_plane(cloud.points, np.random.default_rng(0), off=_HEIGHTS, min_inliers=100, tilt=_STEEPEST)
    if plane is None or plane.normal[2] > np.cos(_TILTED) or plane.inliers < _MOST * level:
        return None
    return plane if _is_wide(cloud, plane) and _below(cloud, plane) < _UNDER else None


def _is_wide(cloud: Cloud, plane: Plane) -> bool:
    """Whether what a plane holds is larger than faces of objects."""
    held = cloud.points[np.abs(plane.heights(cloud.points)) < TOLERANCE, :2]
    return bool(np.ptp(held, axis=0).min() > _WIDE)


def _reaches_beyond(cloud: Cloud, plane: Plane) -> bool:
    """Whether a plane is seen beside what stands on it, as a table is; the rim of an object's underside is not."""
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
    """Share of what is off a plane that lies under it; 0 where next to nothing is off it."""
    heights = plane.heights(cloud.points)
    off = heights[np.abs(heights) > 0.015]
    return float((off < 0).mean()) if len(off) >= MIN_POINTS else 0.0


def _choose(found: list[Cloud], points: int, near: Array | None, base: Array) -> int:
    """Return which of the objects is meant."""
    if not found:
        raise _NoObjectError(NO_OBJECT, f"{points} points above the table")
    inside = [k for k, one in enumerate(found) if _in_reach(one)]
    if near is not None:
        gaps = [np.linalg.norm(c.points - near, axis=1).min() for c in found]
        best = int(np.argmin(gaps))
        if gaps[best] > _NEAR:
            raise _NoObjectError(NOTHING_NEAR, f"the nearest is {100 * gaps[best]:.0f} cm away")
    elif len(inside) > 1:
        raise _NoObjectError(SEVERAL, _places([found[k] for k in inside], base))
    else:
        best = inside[0] if inside else 0
    if best not in inside:
        raise _NoObjectError(OUT_OF_REACH, _places([found[best]], base))
    return best


def _in_reach(cloud: Cloud) -> bool:
    return bool(inside(middle(cloud.points[:, :2])[None], CROP_LOW[:2], CROP_HIGH[:2]).all())


def _places(found: list[Cloud], base: Array) -> str:
    """Say where things are and how large, the first few."""
    said = [in_words(middle(c.points) - base, np.ptp(c.points, axis=0)) for c in found[:8]]
    return "; ".join(said) + ("; ..." if len(found) > 8 else "")
