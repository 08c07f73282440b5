"""Depth images to the segmented cloud of one object, or the reason why there is none."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.cloud import (
    Cloud,
    crop,
    downsample,
    gather,
    largest_cluster,
    pad,
    remove_flying,
    remove_outliers,
)
from dexgrasp_env.perception.level import level_views, view_corrections
from dexgrasp_env.perception.normals import smooth
from dexgrasp_env.perception.plane import (
    Plane,
    fit_plane,
    noise_depth,
    refine_plane,
    remove_plane,
    table_clearance,
)
from dexgrasp_env.perception.robot import RobotShape, remove_robot
from dexgrasp_env.robot.camera import Camera

if TYPE_CHECKING:
    import mujoco

OUT_OF_VIEW = "object_out_of_view"
TOO_FEW = "too_few_points"
NO_PLANE = "plane_not_found"
REASONS = (OUT_OF_VIEW, TOO_FEW, NO_PLANE)


@dataclass(frozen=True)
class SegmentationSettings:
    """Settings of the pipeline; lengths in metres, world frame.

    Attributes:
        count: points returned.
        min_points: fewer raw points are no object.
        crop_low, crop_high: the box in which objects are looked for.
        table_height: where the table is expected, within 5 cm.
        clearance_sigmas: points lower than this many times the table's noise, at their depth, are table.
        robot_margin: points this close to the robot are its own.
        outlier_radius, outlier_neighbours: a point needs so many others so near.
        link: the object's points are linked by steps of at most this.
        smoothing_radius: of the local planes that average noise out.
        stride: every so many-th pixel goes into the fits of the table.
    """

    count: int = 1024
    min_points: int = 40
    crop_low: tuple[float, float, float] = (0.28, -0.40, -0.03)
    crop_high: tuple[float, float, float] = (0.78, 0.40, 0.30)
    table_height: float = 0.0
    clearance_sigmas: float = 4.5
    robot_margin: float = 0.012
    outlier_radius: float = 0.012
    outlier_neighbours: int = 4
    link: float = 0.015
    smoothing_radius: float = 0.010
    stride: int = 7

    def __post_init__(self) -> None:
        if self.count < 1 or self.min_points < 4 or self.stride < 1:
            raise InputError("segmentation needs count >= 1, min_points >= 4 and stride >= 1")
        if not all(a < b for a, b in zip(self.crop_low, self.crop_high, strict=True)):
            raise InputError(f"crop box is empty: low {self.crop_low} must be below high {self.crop_high}")


@dataclass(frozen=True, eq=False)
class SegmentedCloud:
    """The object as seen; all arrays have `count` rows.

    Attributes:
        points: (N, 3) m, world frame, zeros where the mask is false.
        normals: (N, 3) unit, out of the object.
        mask: (N,) which rows hold a point.
        plane: the table, or None.
        reason: None, or one of `REASONS`.
        n_raw: points of the object before downsampling.
        pixels: (N,) index of each point's pixel in the flattened (cameras, H, W) images, -1 where none.
    """

    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    mask: NDArray[np.bool_]
    plane: Plane | None
    reason: str | None
    n_raw: int
    pixels: NDArray[np.int32] = field(default_factory=lambda: np.empty(0, np.int32))

    @property
    def valid_points(self) -> NDArray[np.float32]:
        """The points without padding, (M, 3) m."""
        return self.points[self.mask]

    @property
    def valid_normals(self) -> NDArray[np.float32]:
        """The normals of these, (M, 3)."""
        return self.normals[self.mask]


def segment(
    depths: NDArray[Any],
    cameras: tuple[Camera, ...],
    rng: Generator,
    settings: SegmentationSettings | None = None,
    robot: RobotShape | None = None,
    data: "mujoco.MjData | None" = None,
) -> SegmentedCloud:
    """Return the object's cloud from depth images.

    Args:
        depths: (cameras, H, W) m along the optical axis; NaN, inf and values <= 0 are no measurement.
        cameras: one to many, as believed.
        rng: draws the plane hypotheses and the subset; the same state gives the same cloud.
        settings: of the steps.
        robot: the robot's shape; None removes no robot.
        data: current kinematics of the robot; needed with `robot`.

    Returns:
        A cloud. Whatever the images hold, no exception: `reason` says why it is empty.
    """
    s = settings or SegmentationSettings()
    depths = np.asarray(depths)
    if depths.shape[0] != len(cameras):
        raise InputError(f"{depths.shape[0]} depth images for {len(cameras)} cameras: valid is one each")
    everything = gather(remove_flying(depths), cameras)
    if not len(everything):
        return _nothing(s, None, OUT_OF_VIEW, 0)
    sparse = everything.select(slice(None, None, s.stride))
    plane = fit_plane(sparse.points, rng, height=s.table_height, tolerance=0.010)
    if plane is None:
        return _nothing(s, None, NO_PLANE, 0)
    corrections = view_corrections(sparse, plane, len(cameras))
    table = level_views(sparse, corrections)
    plane = refine_plane(table.points, plane.normal, plane.offset, 0.010) or plane
    found = level_views(crop(everything, s.crop_low, s.crop_high), corrections)
    return finish(_isolate(found, plane, noise_depth(table, plane), s, robot, data), plane, s, rng)


def _isolate(
    cloud: Cloud,
    plane: Plane,
    reference: float,
    s: SegmentationSettings,
    robot: RobotShape | None,
    data: "mujoco.MjData | None",
) -> Cloud:
    cloud = remove_plane(cloud, plane, table_clearance(plane, cloud.depth, reference, s.clearance_sigmas))
    if robot is not None and data is not None:
        cloud = remove_robot(cloud, robot, data, s.robot_margin)
    return largest_cluster(remove_outliers(cloud, s.outlier_radius, s.outlier_neighbours), s.link)


def finish(cloud: Cloud, plane: Plane, s: SegmentationSettings, rng: Generator) -> SegmentedCloud:
    """Return an isolated object as `count` smoothed points, or the reason why it is none."""
    if len(cloud) < s.min_points:
        return _nothing(s, plane, TOO_FEW if len(cloud) else OUT_OF_VIEW, len(cloud))
    chosen = cloud.select(downsample(cloud.points, s.count, rng))
    points, normals = smooth(cloud, chosen, plane.rms, s.smoothing_radius)
    return SegmentedCloud(
        points=pad(points.astype(np.float32), s.count),
        normals=pad(normals.astype(np.float32), s.count),
        mask=np.arange(s.count) < len(chosen),
        plane=plane,
        reason=None,
        n_raw=len(cloud),
        pixels=pad(chosen.pixel + 1, s.count) - 1,
    )


def _nothing(s: SegmentationSettings, plane: Plane | None, reason: str, n_raw: int) -> SegmentedCloud:
    empty = np.zeros((s.count, 3), np.float32)
    return SegmentedCloud(
        empty, empty.copy(), np.zeros(s.count, bool), plane, reason, n_raw, np.full(s.count, -1, np.int32)
    )
