"""The pipeline of perception: a cloud, its table, the instances that stand on it, the one that is meant.

Data goes one way: depth images (`segment`) or a recorded cloud (`find_object`) -> `plane`, `support` -> `instances` ->
`selection` -> `Scene`.
"""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, Fields, middle, unit
from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.cloud import (
    MIN_POINTS,
    WORKSPACE_HIGH,
    WORKSPACE_LOW,
    Cloud,
    crop,
    downsample,
    gather,
    remove_flying,
    remove_outliers,
    smooth,
    thinned,
)
from dexgrasp_env.perception.instances import Instances, segment_instances
from dexgrasp_env.perception.neighbourhoods import linked
from dexgrasp_env.perception.obstacles import Obstacles, find_obstacles
from dexgrasp_env.perception.plane import (
    Plane,
    fit_plane,
    level_views,
    refine_plane,
    table_clearance,
    view_corrections,
)
from dexgrasp_env.perception.reasons import NoTargetError
from dexgrasp_env.perception.refinement import refine_instances
from dexgrasp_env.perception.robot import Own
from dexgrasp_env.perception.scene import ObjectCloud, Scene
from dexgrasp_env.perception.selection import TargetSelector, check_reach
from dexgrasp_env.perception.standing import foot_of, without_skirt
from dexgrasp_env.perception.support import Support, find_support, near_base, table_around
from dexgrasp_env.poses import inverse, placed
from dexgrasp_env.robot.camera import Camera
from dexgrasp_env.robot.cell import Cell

COUNT = 1024  # points of an object that is meant, at most
SIGMAS = 4.5  # points lower than this many times the table's noise, at their depth, are table


def segment(
    depths: NDArray[Any],
    cameras: tuple[Camera, ...],
    rng: Generator,
    own: Own | None = None,
    selector: TargetSelector | None = None,
) -> Scene:
    """Return the scene that depth images show.

    Args:
        depths: (cameras, H, W) m along the optical axis; NaN, inf and values <= 0 are no measurement.
        cameras: one to many, as believed.
        rng: draws the plane hypotheses and the subset; the same state gives the same cloud.
        own: tells the robot's points, see `RobotShape.at`; None where no robot is in the images.
        selector: of the object that is meant, world frame, a mask having the images' shape; None: the largest.

    Returns:
        A scene. Whatever the images hold, no exception: `reason` says why there is no object in it.
    """
    depths = np.asarray(depths)
    if depths.shape[0] != len(cameras):
        raise InputError(f"{depths.shape[0]} depth images for {len(cameras)} cameras: valid is one each")
    everything, poses = gather(remove_flying(depths), cameras), np.stack([c.T_world_camera for c in cameras])
    if not len(everything):
        return Scene(reason="object_out_of_view", cameras=poses)
    sparse = everything.select(np.arange(0, len(everything), 7))  # enough for the table
    plane = fit_plane(sparse.points, rng)
    if plane is None:
        return Scene(reason="plane_not_found", cameras=poses)
    corrections = view_corrections(sparse, plane, len(cameras))
    table = level_views(sparse, corrections)
    plane = refine_plane(table.points, plane.normal, plane.offset) or plane
    found = level_views(crop(everything, WORKSPACE_LOW, WORKSPACE_HIGH), corrections)
    clearance = table_clearance(plane, table, found.depth, SIGMAS)
    above = isolate(found, plane, clearance, own)
    instances, number = _selected(above, selector or TargetSelector(), plane)
    return replace(scene_around(above, instances, number, plane, rng), cameras=poses)


def _selected(cloud: Cloud, selector: TargetSelector, plane: Plane) -> tuple[Instances, int]:
    """Return the things in a cloud, and the number of the one that is meant."""
    marked, near = selector.marks(cloud), selector.near
    if marked is None and near is None:  # there is but one, so that what is near it is of it
        labels = linked(cloud.points, 0.015)  # m: an object's points are linked by steps of at most this
        counts = np.bincount(labels, minlength=1)
        return Instances(labels, ("",) * len(counts)), int(counts.argmax())
    instances = segment_instances(cloud, plane)
    if marked is not None:
        return instances.with_marked(marked)
    if near is None or not len(cloud):
        return instances, 0
    return instances, int(instances.labels[((cloud.points - near) ** 2).sum(1).argmin()])


def find_object(
    cloud: Cloud,
    rng: Generator,
    cell: Cell,
    *,
    selector: TargetSelector | None = None,
    own: Own | None = None,
) -> Scene:
    """Return the scene of a recorded cloud: the object that is meant, and what stands around it.

    Args:
        cloud: points in the frame of the robot's base, m; robot and table may be in it.
        rng: draws the plane hypotheses and the subset.
        cell: where the table and the robot's base are.
        selector: of the object that is meant, in the frame of the base; None takes the only one in the workspace.
        own: tells the robot's points, see `RobotShape.at`; None removes none.

    Returns:
        The scene in the world, or why there is no object: a key of `WORDS`; all that are seen are neighbours then.

    Raises:
        InputError: for a mask that is not the cloud's.
    """
    selector, objects = (selector or TargetSelector()).moved(cell.base), list[tuple[Cloud, str]]()
    plane: Plane | None = None
    selector.marks(cloud)  # a mask of something else is a mistake whatever the cloud shows
    try:
        cloud, support, above, obstacles = stand_on(cloud, rng, cell, own, selector)
        selector, cell, plane = selector.placed(cloud, support.T), support.cell, support.plane
        instances = refine_instances(above, support.cloud, plane, pointed=selector.points)
        numbers = instances.objects(above)
        objects = [(above.select(instances.labels == k), instances.doubts[k]) for k in numbers]
        if (marked := selector.marks(above)) is not None:
            instances, number = instances.with_marked(marked)
            found = above.select(marked)
            if len(found) < MIN_POINTS:
                raise NoTargetError("nothing_marked", f"{len(found)} points")
            check_reach(found, cell.T_base_world)
        else:
            number = numbers[selector.choose([one for one, _ in objects], len(above), cell.T_base_world)]
    except NoTargetError as refused:
        seen = tuple(object_cloud(one, None, COUNT, doubt, cameras_known=False) for one, doubt in objects)
        return Scene(
            plane=plane, reason=refused.reason, sentence=refused.sentence, neighbours=seen, table=cell.table
        )
    scene = scene_around(above, instances, number, plane, rng, cameras_known=False)
    scene = replace(scene, boxes=obstacles.boxes, note=obstacles.note, table=cell.table)
    if not len(scene.target):
        return scene
    table = table_around(support, scene.target.points)
    return scene.standing_on(table, cell.seeing(table).T_world_base @ cell.T_base_world)


def stand_on(
    cloud: Cloud, rng: Generator, cell: Cell, own: Own | None = None, selector: TargetSelector | None = None
) -> tuple[Cloud, Support, Cloud, Obstacles]:
    """Return a recorded cloud in the world, its table, and what stands there: points, and obstacles.

    Raises:
        NoTargetError: where there is no table.
    """
    cloud = near_base(cloud)
    cloud = cloud.moved(cloud.points + cell.base)
    support = find_support(cloud, rng, cell, (selector or TargetSelector()).meant(cloud))
    clearance = max(0.004, SIGMAS * support.plane.rms)
    robot = (
        np.zeros(len(cloud), bool) if own is None else own(placed(inverse(support.T), support.cloud.points))
    )
    above = isolate(support.cloud.select(~robot), support.plane, clearance)
    # m beyond the workspace within which things are in the way of a recorded object, or hang in the arm's.
    above = crop(above, np.subtract(WORKSPACE_LOW, 0.25), np.add(WORKSPACE_HIGH, (0.25, 0.25, 0.9)))
    obstacles = find_obstacles(above.points, support.levels, clearance, support.cloud.points[robot])
    return cloud, support, above.select(~obstacles.points), obstacles


def isolate(cloud: Cloud, plane: Plane, clearance: float | Array, own: Own | None = None) -> Cloud:
    """Return the points of a cloud that are neither the table's, `clearance` m high, nor the robot's, nor alone."""
    cloud = cloud.select(plane.heights(cloud.points) > clearance)
    if own is not None:
        cloud = cloud.select(~own(cloud.points))
    return remove_outliers(cloud)


def scene_around(
    cloud: Cloud, instances: Instances, number: int, plane: Plane, rng: Generator, *,
    cameras_known: bool = True,
) -> Scene:  # fmt: skip
    """Return the scene in which one of the things in an isolated cloud is the target, and the others stand around."""
    numbers = [number, *(k for k in instances.objects(cloud) if k != number)]
    seen = partial(object_cloud, plane=plane, cameras_known=cameras_known)
    things = list[tuple[Cloud, Fields]]()
    for k in numbers:
        mine, foot = instances.labels == k, 0.0
        if not cameras_known:
            foot = foot_of(cloud.points, mine)
            mine[mine] = without_skirt(cloud.points[mine])
        things.append((cloud.select(mine), {"doubt": instances.doubts[k], "foot": foot}))
    (target, said), *others = things
    spacing = (
        np.inf if cameras_known else 0.01
    )  # m: recorded things may be walls and bins, which have no gaps
    around = Scene(
        plane=plane,
        neighbours=tuple(seen(one, count=300, spacing=spacing, **its) for one, its in others),
        rest=seen(cloud.select(~np.isin(instances.labels, numbers)), count=1000, spacing=spacing),
    )
    if not len(target):
        return replace(around, reason="object_out_of_view")
    # A point counts as often as it is higher than noise takes the table's: small things have few, far above it.
    rises = plane.heights(target.points) / max(0.002, SIGMAS * plane.rms)
    if np.clip(rises, 1.0, 3.0).sum() < MIN_POINTS:
        return replace(around, reason="too_few_points")
    return replace(around, target=seen(target, count=COUNT, rng=rng, **said))


def object_cloud(
    cloud: Cloud,
    plane: Plane | None,
    count: int,
    doubt: str = "",
    rng: Generator | None = None,
    *,
    foot: float = 0.0,
    cameras_known: bool = True,
    spacing: float = np.inf,
) -> ObjectCloud:
    """Return a cloud as `count` smoothed points at most, in single precision, as observations hold them.

    Without a generator the same points are drawn each time. Where it is not known who saw a point, it counts as seen
    from outside, from the middle of the cloud. Where it fills more than twice `count` cells, `spacing` m wide, a point
    of each is added.
    """
    if not len(cloud):
        return ObjectCloud()
    if not cameras_known:
        cloud = replace(cloud, views=unit(cloud.points - middle(cloud.points)))
    rows = downsample(cloud.points, count, rng or np.random.default_rng(len(cloud)))
    cells = thinned(cloud.points, spacing)
    chosen = cloud.select(np.union1d(rows, cells) if len(cells) > 2 * count else rows)
    points, normals = smooth(cloud, chosen, 0.0 if plane is None else plane.rms)
    return ObjectCloud(points.astype(np.float32), normals.astype(np.float32), chosen.pixel, doubt, foot)
