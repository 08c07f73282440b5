"""A recorded scene read from a file: ply, pcd, xyz, npy or npz, or a folder of depth images with their cameras.

What is read becomes a `Cloud` in the robot base frame, metres, as the simulated cameras make it: everything after this
file is the code that they go through as well.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import read_npz
from dexgrasp_env.perception.cloud import Cloud, check_count
from dexgrasp_env.perception.depth_folder import CAMERAS_FILE, check_scan, read_views
from dexgrasp_env.perception.pcd import read_pcd

SUFFIXES = (".ply", ".pcd", ".xyz", ".npy", ".npz")
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}


def read_scan(path: Path, unit: str = "m") -> Cloud:
    """Read a scene.

    Args:
        path: a cloud in the robot base frame (`SUFFIXES`), or a folder with `cameras.yaml` and its depth images.
        unit: of the file's coordinates, of `UNITS`; a folder says its own.

    Raises:
        InputError: if it cannot be read, holds no points, or is no such file.
    """
    if path.is_dir():
        if unit != "m":
            raise InputError(
                f"{path} is a folder: depth_scale in its {CAMERAS_FILE} gives the unit of its images"
            )
        return read_views(path)
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: valid clouds are {', '.join(SUFFIXES)}, or a folder with {CAMERAS_FILE}")
    check_scan(path)
    readers = {".ply": _read_ply, ".pcd": read_pcd, ".xyz": _read_xyz, ".npy": _read_npy, ".npz": _read_npz}
    try:
        points = readers[path.suffix.lower()](path)
    except InputError:
        raise
    except Exception as error:  # parsers of damaged files raise whatever they trip over
        raise InputError(
            f"{path} cannot be read as a point cloud ({type(error).__name__}: {error})"
        ) from None
    cloud = cloud_of(points, str(path))
    return replace(cloud, points=cloud.points * UNITS[unit])


def cloud_of(points: Any, source: str = "points") -> Cloud:
    """Return points (N, 3) m, robot base frame, as a cloud; rows that are not finite are left out.

    The cameras are unknown, so every point counts as seen from above and from one metre away.

    Raises:
        InputError: for another shape, too many rows, what is no numbers, or where no finite row is left.
    """
    try:
        rows = np.asarray(points)
        if rows.ndim == 3 and rows.shape[-1] >= 3:  # organised clouds
            rows = rows.reshape(-1, rows.shape[-1])
        if rows.ndim != 2 or rows.shape[1] < 3:
            raise InputError(f"{source}: a cloud has shape (N, 3), got {rows.shape}")
        check_count(len(rows), source)
        rows = rows[:, :3].astype(float)
    except InputError:
        raise
    except (TypeError, ValueError):
        raise InputError(f"{source}: a cloud is an array of numbers, (N, 3) in metres") from None
    known = np.flatnonzero(np.isfinite(rows).all(1)).astype(np.int32)
    shape, rows = rows.shape[:1], np.ascontiguousarray(rows[known])
    if not len(rows):
        raise InputError(f"{source} holds no finite point")
    n = len(rows)
    up = np.tile([0.0, 0.0, 1.0], (n, 1))
    return Cloud(rows, up, np.ones(n), np.zeros(n, np.int32), known, shape)


def _read_ply(path: Path) -> Array:
    import trimesh

    loaded = trimesh.load(path, file_type="ply", process=False)
    vertices = getattr(loaded, "vertices", None)
    if vertices is None or not len(vertices):
        raise InputError(f"{path} holds no vertices")
    return np.asarray(vertices, dtype=float)


def _read_npy(path: Path) -> NDArray[Any]:
    return np.load(path, allow_pickle=False)


def _read_npz(path: Path) -> NDArray[Any]:
    arrays = read_npz(path)
    name = "points" if "points" in arrays else next(iter(arrays)) if len(arrays) == 1 else None
    if name is None:
        raise InputError(f"{path} has arrays {', '.join(arrays) or 'none'}: name the cloud 'points'")
    return arrays[name]


def _read_xyz(path: Path) -> Array:
    """Read rows of x, y, z and whatever follows, in words or with commas; lines of `#` are remarks."""
    with path.open() as file:
        rows = (line.replace(",", " ") for line in file)
        return np.loadtxt(rows, ndmin=2, usecols=(0, 1, 2))
