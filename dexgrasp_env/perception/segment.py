"""Depth images to the scene with one object, or the reason why there is none, and what else stands on the table."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, middle, unit
from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.cloud import (
    Cloud,
    crop,
    downsample,
    gather,
    remove_flying,
    remove_outliers,
    smooth,
)
from dexgrasp_env.perception.instances import (
    LEAST_EXTENT,
    LEAST_POINTS,
    MOST_EXTENT,
    Parting,
    longest_side,
    parted,
)
from dexgrasp_env.perception.neighbourhoods import linked
from dexgrasp_env.perception.plane import (
    Plane,
    fit_plane,
    level_views,
    noise_depth,
    refine_plane,
    remove_plane,
    table_clearance,
    view_corrections,
)
from dexgrasp_env.perception.pointing import Pointing
from dexgrasp_env.perception.robot import Own
from dexgrasp_env.perception.scene import ObjectCloud, Scene
from dexgrasp_env.robot.camera import Camera

OUT_OF_VIEW = "object_out_of_view"
TOO_FEW = "too_few_points"
NO_PLANE = "plane_not_found"
COUNT = 1024  # points of an object that is meant, at most
MIN_POINTS = 40  # fewer raw points are no object
# m, of the box in which objects are looked for
CROP_LOW, CROP_HIGH = (0.28, -0.40, -0.03), (0.78, 0.40, 0.30)
SIGMAS = 4.5  # points lower than this many times the table's noise, at their depth, are table
LINK = 0.015  # m: an object's points are linked by steps of at most this
STRIDE = 7  # every so many-th pixel goes into the fits of the table
_OTHERS, _REST = 300, 1000  # points of a neighbour, and of what belongs to no object, at most
REASONS = (OUT_OF_VIEW, TOO_FEW, NO_PLANE)


def objects_of(cloud: Cloud, parting: Parting) -> list[int]:
    """Return the numbers of those things on the table that are objects, the largest first."""
    counts = np.bincount(parting.labels)
    found = [
        k
        for k in np.flatnonzero(counts >= LEAST_POINTS).tolist()
        if LEAST_EXTENT <= longest_side(cloud.points[parting.labels == k]) <= MOST_EXTENT
    ]
    return sorted(found, key=lambda k: -counts[k])


def object_cloud(
    cloud: Cloud,
    plane: Plane | None,
    count: int,
    doubtful: bool = False,
    rng: Generator | None = None,
    *,
    cameras_known: bool = True,
) -> ObjectCloud:
    """Return a cloud as `count` smoothed points at most, in single precision, as observations hold them.

    Without a generator the same points are drawn each time. Where it is not known who saw a point, it counts as seen
    from outside, from the middle of the cloud.
    """
    if not len(cloud):
        return ObjectCloud()
    if not cameras_known:
        cloud = replace(cloud, views=unit(cloud.points - middle(cloud.points)))
    chosen = cloud.select(downsample(cloud.points, count, rng or np.random.default_rng(len(cloud))))
    points, normals = smooth(cloud, chosen, 0.0 if plane is None else plane.rms)
    return ObjectCloud(points.astype(np.float32), normals.astype(np.float32), chosen.pixel, doubtful)


@dataclass(frozen=True, eq=False)
class Seen:
    """An object on the table, for people who point at one.

    Attributes:
        number: from 1 on; the one that is meant comes first.
        place: (3,) m, the middle of the box around it, in the frame of the robot's base.
        extents: (3,) m, the sides of that box.
        next: m to the nearest of the others; infinity where there is none.
        apart: m to the one that comes first.
        doubtful: whether it may be two, or a part of the next.
    """

    number: int
    place: Array
    extents: Array
    next: float
    apart: float
    doubtful: bool = False

    def __str__(self) -> str:
        return in_words(self.place, self.extents)


def in_words(place: Array, sides: Array) -> str:
    """Return for people where something is, (3,) m, and how large, (3,) m."""
    size = " x ".join(f"{100 * side:.0f}" for side in sides)
    return f"{size} cm at ({', '.join(f'{x:.2f}' for x in place)})"


def listed(scene: Scene, base: Array) -> list[Seen]:
    """Return the objects that a scene shows, `base` (3,) m being where the robot's base is in the world."""
    from scipy.spatial import cKDTree

    shown = [one for one in (scene.target, *scene.neighbours) if len(one)]
    clouds = [one.points for one in shown]
    gaps = np.array(
        [[cKDTree(a).query(b)[0].min() if a is not b else np.inf for b in clouds] for a in clouds]
    )
    return [
        Seen(k, middle(points) - base, np.ptp(points, axis=0), float(own.min()), float(own[0]), one.doubtful)
        for k, (one, points, own) in enumerate(zip(shown, clouds, gaps, strict=True), start=1)
    ]


def segment(
    depths: NDArray[Any],
    cameras: tuple[Camera, ...],
    rng: Generator,
    own: Own | None = None,
    pointing: Pointing | None = None,
) -> Scene:
    """Return the scene that depth images show.

    Args:
        depths: (cameras, H, W) m along the optical axis; NaN, inf and values <= 0 are no measurement.
        cameras: one to many, as believed.
        rng: draws the plane hypotheses and the subset; the same state gives the same cloud.
        own: tells the robot's points, see `RobotShape.at`; None where no robot is in the images.
        pointing: which object is meant, world frame, a mask having the images' shape; None: the largest.

    Returns:
        A scene. Whatever the images hold, no exception: `reason` says why there is no object in it.
    """
    depths = np.asarray(depths)
    if depths.shape[0] != len(cameras):
        raise InputError(f"{depths.shape[0]} depth images for {len(cameras)} cameras: valid is one each")
    everything = gather(remove_flying(depths), cameras)
    found = _object(everything, len(cameras), rng, own, pointing or Pointing())
    return replace(found, cameras=np.stack([camera.T_world_camera for camera in cameras]))


def _object(everything: Cloud, views: int, rng: Generator, own: Own | None, pointing: Pointing) -> Scene:
    if not len(everything):
        return Scene(reason=OUT_OF_VIEW)
    sparse = everything.select(slice(None, None, STRIDE))
    plane = fit_plane(sparse.points, rng)
    if plane is None:
        return Scene(reason=NO_PLANE)
    corrections = view_corrections(sparse, plane, views)
    table = level_views(sparse, corrections)
    plane = refine_plane(table.points, plane.normal, plane.offset) or plane
    found = level_views(crop(everything, CROP_LOW, CROP_HIGH), corrections)
    clearance = table_clearance(plane, found.depth, noise_depth(table, plane), SIGMAS)
    above = isolate(found, plane, clearance, own)
    return divided(above, *_meant(above, pointing, plane), plane, rng)


def _meant(cloud: Cloud, pointing: Pointing, plane: Plane) -> tuple[Parting, int]:
    """Return which thing each point of a cloud is of, and the number of the one that is pointed at."""
    marked = pointing.marks(cloud)
    near = pointing.near
    if marked is None and near is None:  # there is but one, so that what is near it is of it
        labels = linked(cloud.points, LINK)
        counts = np.bincount(labels, minlength=1)
        return Parting(labels, np.zeros(len(counts), bool)), int(counts.argmax())
    parting = parted(cloud, plane)
    if marked is not None:
        return parting.with_marked(marked)
    if near is None or not len(cloud):
        return parting, 0
    return parting, int(parting.labels[((cloud.points - near) ** 2).sum(1).argmin()])


def isolate(cloud: Cloud, plane: Plane, clearance: float | Array, own: Own | None) -> Cloud:
    """Return the points of a cloud that are neither the table's, `clearance` m high, nor the robot's, nor alone."""
    cloud = remove_plane(cloud, plane, clearance)
    if own is not None:
        cloud = cloud.select(~own(cloud.points))
    return remove_outliers(cloud)


def divided(
    cloud: Cloud, parting: Parting, number: int, plane: Plane, rng: Generator, *,
    cameras_known: bool = True,
) -> Scene:  # fmt: skip
    """Return the scene in which one of the things in an isolated cloud is the target, and the others stand around."""
    numbers = [number, *(k for k in objects_of(cloud, parting) if k != number)]
    target, *others = (cloud.select(parting.labels == k) for k in numbers)
    doubtful, *doubts = map(bool, parting.doubtful[numbers])
    seen = partial(object_cloud, plane=plane, cameras_known=cameras_known)
    around = Scene(
        plane=plane,
        neighbours=tuple(
            seen(one, count=_OTHERS, doubtful=doubt) for one, doubt in zip(others, doubts, strict=True)
        ),
        rest=seen(cloud.select(~np.isin(parting.labels, numbers)), count=_REST),
    )
    if len(target) < MIN_POINTS:
        return replace(around, reason=TOO_FEW if len(target) else OUT_OF_VIEW)
    return replace(around, target=seen(target, count=COUNT, doubtful=doubtful, rng=rng))
