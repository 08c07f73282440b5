"""One object out of the cloud of a whole scene, or the reason why there is none.

For clouds that come from a file or from a user's own cameras: unlike in `segment`, nothing is known of the images they
were made from, and a wrong unit or frame is likelier than noise. What comes in, and what is said of it, is in the frame
of the robot's base; what goes out is in the world's.
"""

import numpy as np
from numpy.random import Generator

from dexgrasp_env.arrays import Array
from dexgrasp_env.perception.cloud import Cloud, crop
from dexgrasp_env.perception.objects import extents, object_cloud, objects_of, seen_from_outside
from dexgrasp_env.perception.parting import parted
from dexgrasp_env.perception.plane import TOLERANCE, Plane, fit_plane
from dexgrasp_env.perception.pointing import Pointing
from dexgrasp_env.perception.robot import Own
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.perception.segment import SegmentationSettings, divided, isolate
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
    TILTED: "the table is not level in the frame of the robot's base: is the cloud in that frame, z up?",
    TABLE_HEIGHT: "the table is not at the height above the robot's base that the cell has it at (table_height)",
    NO_OBJECT: "nothing stands on the table within the workspace",
    NOTHING_NEAR: "no object near the point that was named",
    NOTHING_MARKED: "nothing that stands on the table is in the box or the mask",
    SEVERAL: "several objects are in the workspace: point at the one that is meant by a point near it, a box or a mask",
    OUT_OF_REACH: "the object stands outside the workspace of the arm",
}
"""Reason -> what it means and what to do."""

_S = SegmentationSettings()
_VOXEL = 0.002  # m: denser clouds are thinned to one point a cell
_ROOM = 2.0  # m around the base: what is farther is no business of the arm
_LARGEST = 5.0  # m from the base: beyond, the unit is wrong
_HEIGHTS = 0.30  # m above and below the cell's table where one is looked for, to say where it is
_TABLE_OFF = 0.02  # m that the table may be off the cell's
_TILTED, _STEEPEST = np.radians(3.0), np.radians(40.0)  # of a table that is not level, least and most
_MOST, _UNDER = (
    1.5,
    0.1,
)  # points that it holds to one that the best level plane does; share under it, at most
_BESIDE, _JUDGED = 0.1, 2000  # share of a table that is seen beside what stands on it; of so many points
_WIDE = 0.14  # m, both ways, of a table that is seen
_BELOW = 0.5  # share of the points near the table that lie under it, from where the cloud is upside down
_AROUND = 0.25  # m beyond the workspace within which things stand in the way
_NEAR = 0.08  # m from the named point to the object


class _NoObjectError(Exception):
    """There is no object: a key of `WORDS`, and figures."""


def find_object(
    cloud: Cloud,
    rng: Generator,
    cell: Cell,
    *,
    pointing: Pointing | None = None,
    own: Own | None = None,
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
    pointing, objects, doubtful = (pointing or Pointing()).moved(cell.base), list[Cloud](), list[bool]()
    pointing.marks(cloud)  # a mask of something else is a mistake whatever the cloud shows
    try:
        cloud = _in_metres(cloud)
        cloud = cloud.moved(cloud.points + cell.base)
        plane = _find_table(cloud, rng, cell)
        above = isolate(cloud, plane, max(0.004, _S.clearance_sigmas * plane.rms), _S, own)
        above = crop(above, np.array(_S.crop_low) - _AROUND, np.array(_S.crop_high) + _AROUND)
        parting = parted(above, plane)
        numbers = objects_of(above, parting)
        objects = [above.select(parting.labels == k) for k in numbers]
        doubtful = [bool(parting.doubtful[k]) for k in numbers]
        if (marked := pointing.marks(above)) is not None:
            parting, number = parting.with_marked(marked)
            _check_marked(above.select(marked), cell.base)
        else:
            number = numbers[_choose(objects, len(above), pointing.near, cell.base)]
    except _NoObjectError as refused:
        reason, detail = refused.args
        words = WORDS[reason]
        seen = tuple(
            object_cloud(seen_from_outside(one), None, _S.smoothing_radius, _S.count, doubt)
            for one, doubt in zip(objects, doubtful, strict=True)
        )
        return Scene(reason=reason, sentence=f"{words} ({detail})" if detail else words, neighbours=seen)
    return divided(above, parting, number, plane, _S, rng, cameras_known=False)


def _in_metres(cloud: Cloud) -> Cloud:
    """Return what is around the base, thinned to one point a voxel, the first of each."""
    if len(cloud) < _S.min_points:
        raise _NoObjectError(EMPTY, f"{len(cloud)} points")
    if float(np.median(np.abs(cloud.points).max(axis=1))) > _LARGEST:
        raise _NoObjectError(UNIT, f"median distance from the base {np.median(np.abs(cloud.points)):.0f}")
    cloud = crop(cloud, (-_ROOM,) * 3, (_ROOM,) * 3)
    cells = np.floor(cloud.points / _VOXEL).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    if len(first) < _S.min_points:
        raise _NoObjectError(EMPTY, f"{len(first)} points within {_ROOM:g} m of the base")
    return cloud.select(np.sort(first))


def _find_table(cloud: Cloud, rng: Generator, cell: Cell) -> Plane:
    local = crop(cloud, (*_S.crop_low[:2], -np.inf), (*_S.crop_high[:2], np.inf))
    pool = local if len(local) > _S.min_points else cloud
    plane = fit_plane(pool.points, rng, min_inliers=100)
    if plane is None or _below(pool, plane) > _BELOW:
        # A lower table's object may have a top that passes for the table: the largest plane far and wide tells.
        plane = fit_plane(pool.points, rng, off=_HEIGHTS, min_inliers=100)
    _refuse_tilted(pool, 0 if plane is None else plane.inliers)
    if plane is None:
        raise _NoObjectError(NO_TABLE, "")
    if not _is_wide(pool, plane) or not _reaches_beyond(pool, plane):
        raise _NoObjectError(NO_TABLE, "what is level is an object's")
    below = _below(pool, plane)
    if below > _BELOW:
        raise _NoObjectError(UPSIDE_DOWN, f"{100 * below:.0f} % of what is off the table")
    if abs(plane.offset) > _TABLE_OFF:
        found = f"found at z = {plane.offset - cell.base[2]:.3f} m, the cell has {cell.table_height:g} m"
        raise _NoObjectError(TABLE_HEIGHT, found)
    return plane


def _refuse_tilted(cloud: Cloud, level: int) -> None:
    """Raise where a plane that is not level holds more of a cloud than the best level one, with nothing under it."""
    plane = fit_plane(cloud.points, np.random.default_rng(0), off=_HEIGHTS, min_inliers=100, tilt=_STEEPEST)
    if plane is None or plane.normal[2] > np.cos(_TILTED) or plane.inliers < _MOST * level:
        return
    if _is_wide(cloud, plane) and _below(cloud, plane) < _UNDER:
        raise _NoObjectError(TILTED, f"{np.degrees(np.arccos(plane.normal[2])):.0f} degrees")


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
    if not len(level) or not len(above):
        return True
    few = level[:: max(1, len(level) // _JUDGED)]
    return bool((cKDTree(above).query(few)[0] > 2.0 * TOLERANCE).mean() > _BESIDE)


def _below(cloud: Cloud, plane: Plane) -> float:
    """Share of what is off a plane that lies under it; 0 where next to nothing is off it."""
    heights = plane.heights(cloud.points)
    off = heights[np.abs(heights) > 0.015]
    return float((off < 0).mean()) if len(off) >= _S.min_points else 0.0


def _check_marked(found: Cloud, base: Array) -> None:
    """Raise where what box or mask hold is no object that is in reach."""
    if len(found) < _S.min_points:
        raise _NoObjectError(NOTHING_MARKED, f"{len(found)} points")
    if not _in_reach(_middle(found)):
        raise _NoObjectError(OUT_OF_REACH, _places([found], base))


def _choose(found: list[Cloud], points: int, near: Array | None, base: Array) -> int:
    """Return which of the objects is meant."""
    if not found:
        raise _NoObjectError(NO_OBJECT, f"{points} points above the table")
    inside = [k for k, one in enumerate(found) if _in_reach(_middle(one))]
    if near is not None:
        gaps = [float(np.linalg.norm(c.points - near, axis=1).min()) for c in found]
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


def _in_reach(point: Array) -> bool:
    low, high = np.array(_S.crop_low[:2]), np.array(_S.crop_high[:2])
    return bool((point[:2] >= low).all() and (point[:2] <= high).all())


def _middle(cloud: Cloud) -> Array:
    return 0.5 * (cloud.points.min(0) + cloud.points.max(0))


def _places(found: list[Cloud], base: Array) -> str:
    """Say where things are and how large, the first few."""
    said = [
        "{:.0f} x {:.0f} x {:.0f} cm at ({:.2f}, {:.2f}, {:.2f})".format(
            *(100 * extents(c.points)), *(_middle(c) - base)
        )
        for c in found[:8]
    ]
    return "; ".join(said) + ("; ..." if len(found) > 8 else "")
