"""A recorded scene: a cloud of any kind of file, or a folder of depth images with their cameras.

What is read becomes a `Cloud` in the robot base frame, metres, as the simulated cameras make it: everything after this
file is the code that they go through as well.
"""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp_env.arrays import LARGEST, Array
from dexgrasp_env.arrays import unit as unit_vectors
from dexgrasp_env.errors import InputError, understood
from dexgrasp_env.perception.bag_file import BAGS, bag_of, read_bag
from dexgrasp_env.perception.camera_files import CAMERAS_FILE, read_cameras
from dexgrasp_env.perception.cloud import MIN_POINTS, Cloud, check_count, gather, remove_flying
from dexgrasp_env.perception.cloud_files import READERS, check_scan

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}


def read_scan(path: Path, unit: str = "m", T_base_camera: Array | None = None) -> Cloud:
    """Read a scene.

    Args:
        path: a cloud (`READERS`, or a ROS bag, `BAG#TOPIC` where it has several), or a folder with `cameras.yaml` and
            its depth images.
        unit: of the file's coordinates, of `UNITS`; a folder says its own.
        T_base_camera: (4, 4) pose, m, of the frame that the cloud is in, for a camera its optical frame, in the robot
            base frame; of a folder that of its one camera, where its file has none. None: in the robot base frame.

    Raises:
        InputError: if it cannot be read, holds no points, or is no such file.
    """
    bag, topic = bag_of(path), ""
    if bag is None and not path.exists() and "#" in str(path):
        head, _, topic = str(path).partition("#")
        bag = bag_of(Path(head))
    if bag is None and path.is_dir():
        if unit != "m":
            raise InputError(
                f"{path} is a folder: depth_scale in its {CAMERAS_FILE} gives the unit of its images"
            )
        return read_views(path, T_base_camera)
    if bag is None and path.suffix.lower() not in READERS:
        raise InputError(
            f"{path}: valid clouds are {', '.join((*READERS, *BAGS))}, or a folder with {CAMERAS_FILE}"
        )
    check_scan(bag / "metadata.yaml" if bag and bag.is_dir() else bag or path)
    with understood(path, "a point cloud"):
        points = (
            READERS[path.suffix.lower()](path)
            if bag is None
            else read_bag(bag, topic, posed=T_base_camera is not None)
        )
    cloud = cloud_of(points, str(path))
    cloud = cloud.moved(cloud.points * UNITS[unit])
    return cloud if T_base_camera is None else posed(cloud, T_base_camera)


def posed(cloud: Cloud, T_base_camera: Array) -> Cloud:
    """Return a cloud of a camera's frame in that of the robot's base, with what the camera's place says of the rays."""
    away = np.linalg.norm(cloud.points, axis=1)
    points = cloud.points @ T_base_camera[:3, :3].T + T_base_camera[:3, 3]
    return replace(cloud, points=points, views=unit_vectors(T_base_camera[:3, 3] - points), depth=away)


def read_views(folder: Path, T_base_camera: Array | None = None) -> Cloud:
    """Merge the depth images that `cameras.yaml` of a folder names; see `read_cameras`."""
    clouds, shapes, first = list[Cloud](), list[tuple[int, ...]](), 0
    for k, image in enumerate(read_cameras(folder / CAMERAS_FILE, T_base_camera)):
        depth = image.read(folder)
        if any(image.distortion):
            print(f"note: {image.camera.name}: its distortion is undone", file=sys.stderr)
        seen = gather(remove_flying(depth[None]), (image.camera,))
        clouds.append(replace(seen, camera=seen.camera + np.int32(k), pixel=seen.pixel + np.int32(first)))
        check_count(sum(map(len, clouds)), str(folder))
        shapes, first = [*shapes, depth.shape], first + depth.size
    shape = (len(shapes), *shapes[0]) if len(set(shapes)) == 1 else (first,)
    merged = replace(Cloud.join(clouds), shape=shape)
    if not len(merged):
        raise InputError(f"{folder}: no depth image holds a measurement")
    return merged


def cloud_of(points: Any, source: str = "points") -> Cloud:
    """Return points (N, 3) m, robot base frame, as a cloud; rows that are not finite are left out.

    Organised clouds (H, W, 3), rows of axes (3, N) and records with fields x, y, z are taken too. The cameras are
    unknown, so every point counts as seen from above and from one metre away.

    Raises:
        InputError: for another shape, too many rows, what is no numbers, or where no finite row is left.
    """
    try:
        rows = np.asarray(points)
        if {*"xyz"} <= {*(rows.dtype.names or ())}:
            rows = np.stack([rows[axis] for axis in "xyz"], axis=-1)
        if rows.ndim > 1 and rows.shape[0] == 3 and rows.shape[-1] >= MIN_POINTS:  # three points are no cloud
            rows = np.moveaxis(rows, 0, -1)
        if rows.dtype.kind not in "iuf":
            raise TypeError
        if rows.ndim == 3 and 3 <= rows.shape[-1] < 10:  # organised clouds
            rows = rows.reshape(-1, rows.shape[-1])
        if rows.ndim != 2 or rows.shape[1] < 3:
            raise InputError(f"{source}: a cloud has shape (N, 3), got {rows.shape}")
        check_count(len(rows), source)
        rows = rows[:, :3].astype(float)
    except InputError:
        raise
    except (TypeError, ValueError):
        raise InputError(f"{source}: a cloud is an array of numbers, (N, 3) in metres") from None
    known = np.flatnonzero((np.abs(rows) < LARGEST).all(1)).astype(np.int32)
    n = len(known)
    if not n:
        raise InputError(f"{source} holds no finite point")
    up, shape = np.tile([0.0, 0.0, 1.0], (n, 1)), rows.shape[:1]
    return Cloud(np.ascontiguousarray(rows[known]), up, np.ones(n), np.zeros(n, np.int32), known, shape)
