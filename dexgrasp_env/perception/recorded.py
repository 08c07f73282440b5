"""One object out of the cloud of a whole scene, or the reason why there is none.

For clouds that come from a file or from a user's own cameras: unlike in `segment`, nothing is known of the images they
were made from, and a wrong unit or frame is likelier than noise. What comes in, and what is said of it, is in the frame
of the robot's base; what goes out is in the world's.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator

from dexgrasp_env.arrays import Array
from dexgrasp_env.perception.cloud import Cloud, crop, remove_outliers
from dexgrasp_env.perception.plane import Plane, fit_plane
from dexgrasp_env.perception.robot import RobotShape
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.perception.segment import SegmentationSettings, finish
from dexgrasp_env.robot.cell import Cell

if TYPE_CHECKING:
    import mujoco

EMPTY = "empty_cloud"
UNIT = "unit_is_not_metres"
NO_TABLE = "plane_not_found"
UPSIDE_DOWN = "upside_down"
TABLE_HEIGHT = "table_not_at_base_height"
NO_OBJECT = "no_object_on_the_table"
NOTHING_NEAR = "nothing_near_the_point"
SEVERAL = "several_objects"
OUT_OF_REACH = "out_of_reach"

WORDS = {
    EMPTY: "the cloud holds too few points to be a scene",
    UNIT: "the coordinates are too large for metres: millimetres? scale them by 0.001",
    NO_TABLE: "no level plane that could be the table: is the cloud in the robot base frame, z up?",
    UPSIDE_DOWN: "the points lie below the table: z must point up in the robot base frame",
    TABLE_HEIGHT: "the table is not at the height above the robot's base that the cell has it at (table_height)",
    NO_OBJECT: "nothing stands on the table within the workspace",
    NOTHING_NEAR: "no object near the point that was named",
    SEVERAL: "several objects are in the workspace: name a point near the one that is meant",
    OUT_OF_REACH: "the object stands outside the workspace of the arm",
}
"""Reason -> what it means and what to do."""

_VOXEL = 0.002  # m: denser clouds are thinned to one point a cell
_ROOM = 2.0  # m around the base: what is farther is no business of the arm
_LARGEST = 5.0  # m from the base: beyond, the unit is wrong
_HEIGHTS = 0.30  # m above and below the cell's table where one is looked for, to say where it is
_TABLE_OFF = 0.02  # m that the table may be off the cell's
_BELOW = 0.5  # share of the points near the table that lie under it, from where the cloud is upside down
_RIVAL = 0.35  # of the largest cluster's points: a smaller one is a remnant, not another object
_NEAR = 0.08  # m from the named point to the object


def find_object(
    cloud: Cloud,
    rng: Generator,
    cell: Cell,
    *,
    near: Sequence[float] | Array | None = None,
    settings: SegmentationSettings | None = None,
    robot: RobotShape | None = None,
    data: "mujoco.MjData | None" = None,
) -> Scene:
    """Return the scene of a cloud, with the one object that stands on its table.

    Args:
        cloud: points in the frame of the robot's base, m; robot and table may be in it.
        rng: draws the plane hypotheses and the subset.
        cell: where the table and the robot's base are.
        near: (3,) m, a point near the object that is meant; None takes the only one in the workspace.
        settings: of the pipeline.
        robot: its shape, to remove its points; None removes none.
        data: current kinematics of the robot; needed with `robot`.

    Returns:
        The scene in the world, or why there is no object: a key of `WORDS`.
    """
    s = settings or SegmentationSettings()
    if len(cloud) < s.min_points:
        return _none(EMPTY, f"{len(cloud)} points")
    if float(np.median(np.abs(cloud.points).max(axis=1))) > _LARGEST:
        return _none(UNIT, f"median distance from the base {np.median(np.abs(cloud.points)):.0f}")
    cloud = _thinned(crop(cloud, (-_ROOM,) * 3, (_ROOM,) * 3))
    if len(cloud) < s.min_points:
        return _none(EMPTY, f"{len(cloud)} points within {_ROOM:g} m of the base")
    base = cell.base
    cloud = cloud.moved(cloud.points + base)
    plane, reason, detail = _find_table(cloud, rng, s, cell)
    if plane is None:
        return _none(reason, detail)
    above = cloud.select(plane.heights(cloud.points) > max(0.004, s.clearance_sigmas * plane.rms))
    if robot is not None and data is not None:
        above = above.select(~robot.contains(above.points, data, s.robot_margin))
    above = remove_outliers(above, s.outlier_radius, s.outlier_neighbours)
    chosen, reason, detail = _choose(
        above, None if near is None else np.asarray(near, dtype=float) + base, s, base
    )
    if chosen is None:
        return _none(reason, detail)
    return finish(_seen_from_outside(chosen), plane, s, rng)


def _thinned(cloud: Cloud) -> Cloud:
    """One point a voxel, the first of each."""
    cells = np.floor(cloud.points / _VOXEL).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    return cloud.select(np.sort(first))


def _find_table(
    cloud: Cloud, rng: Generator, s: SegmentationSettings, cell: Cell
) -> tuple[Plane | None, str, str]:
    """Return the table, or the reason why there is none and its figures."""
    local = crop(cloud, (*s.crop_low[:2], -np.inf), (*s.crop_high[:2], np.inf))
    pool = local if len(local) > s.min_points else cloud
    plane = fit_plane(pool.points, rng, height=s.table_height, tolerance=0.010, min_inliers=100)
    if plane is None or _below(pool, plane, s) > _BELOW:
        # A lower table's object may have a top that passes for the table: the largest plane far and wide tells.
        plane = fit_plane(
            pool.points,
            rng,
            height=s.table_height,
            height_tolerance=_HEIGHTS,
            tolerance=0.010,
            min_inliers=100,
        )
    if plane is None:
        return None, NO_TABLE, ""
    below = _below(pool, plane, s)
    if below > _BELOW:
        return None, UPSIDE_DOWN, f"{100 * below:.0f} % of what is off the table"
    if abs(plane.offset - s.table_height) > _TABLE_OFF:
        return None, TABLE_HEIGHT, _heights(plane, cell)
    return plane, "", ""


def _below(cloud: Cloud, plane: Plane, s: SegmentationSettings) -> float:
    """Share of what is off a plane that lies under it; 0 where next to nothing is off it."""
    heights = plane.heights(cloud.points)
    off = heights[np.abs(heights) > 0.015]
    return float((off < 0).mean()) if len(off) >= s.min_points else 0.0


def _heights(found: Plane, cell: Cell) -> str:
    return f"found at z = {found.offset - cell.base[2]:.3f} m, the cell has {cell.table_height:g} m"


def _choose(
    cloud: Cloud, near: Array | None, s: SegmentationSettings, base: Array
) -> tuple[Cloud | None, str, str]:
    """Return the cluster that is meant, or the reason and its figures."""
    clusters = [c for c in _clusters(cloud, s.link) if len(c) >= s.min_points]
    if not clusters:
        return None, NO_OBJECT, f"{len(cloud)} points above the table"
    if near is not None:
        gaps = [float(np.linalg.norm(c.points - near, axis=1).min()) for c in clusters]
        best = int(np.argmin(gaps))
        if gaps[best] > _NEAR:
            return None, NOTHING_NEAR, f"the nearest is {100 * gaps[best]:.0f} cm away"
        return _reachable(clusters[best], s, base)
    inside = [c for c in clusters if _in_reach(_middle(c), s)]
    if not inside:
        return None, OUT_OF_REACH, _places(clusters, base)
    inside.sort(key=len, reverse=True)
    rivals = [c for c in inside if len(c) >= _RIVAL * len(inside[0])]
    if len(rivals) > 1:
        return None, SEVERAL, _places(rivals, base)
    return inside[0], "", ""


def _clusters(cloud: Cloud, link: float) -> list[Cloud]:
    if not len(cloud):
        return []
    from dexgrasp_env.perception.kernels import cluster

    labels = cluster(np.ascontiguousarray(cloud.points), link)
    return [cloud.select(labels == k) for k in range(int(labels.max()) + 1)]


def _reachable(cloud: Cloud, s: SegmentationSettings, base: Array) -> tuple[Cloud | None, str, str]:
    if not _in_reach(_middle(cloud), s):
        return None, OUT_OF_REACH, _places([cloud], base)
    return cloud, "", ""


def _in_reach(point: Array, s: SegmentationSettings) -> bool:
    low, high = np.array(s.crop_low[:2]), np.array(s.crop_high[:2])
    return bool((point[:2] >= low).all() and (point[:2] <= high).all())


def _middle(cloud: Cloud) -> Array:
    return 0.5 * (cloud.points.min(0) + cloud.points.max(0))


def _places(clouds: list[Cloud], base: Array) -> str:
    return "at " + ", ".join("({:.2f}, {:.2f}, {:.2f})".format(*(_middle(c) - base)) for c in clouds[:4])


def _seen_from_outside(cloud: Cloud) -> Cloud:
    """Views from the object's middle outwards: a merged cloud does not say who saw a point."""
    out = cloud.points - _middle(cloud)
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    return Cloud(cloud.points, out, cloud.depth, cloud.camera, cloud.pixel)


def _none(reason: str, detail: str = "") -> Scene:
    words = WORDS[reason]
    return Scene(reason=reason, sentence=f"{words} ({detail})" if detail else words)
