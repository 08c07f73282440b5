"""A recorded scene read from a file: ply, pcd, npy or npz, or a folder of depth images with their cameras.

What is read becomes a `Cloud` in the robot base frame, metres, as the simulated cameras make it: everything after this
file is the code that they go through as well.
"""

import io
from itertools import islice
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import read_npz
from dexgrasp_env.perception.cloud import Cloud, check_count
from dexgrasp_env.perception.depth_folder import CAMERAS_FILE, check_scan, read_views

SUFFIXES = (".ply", ".pcd", ".npy", ".npz")
_PCD_LINES = 1_000  # of a header
_PCD_TYPES = {("F", 4): "<f4", ("F", 8): "<f8", ("I", 1): "<i1", ("I", 2): "<i2", ("I", 4): "<i4", ("I", 8): "<i8",
              ("U", 1): "<u1", ("U", 2): "<u2", ("U", 4): "<u4", ("U", 8): "<u8"}  # fmt: skip


def read_scan(path: Path) -> Cloud:
    """Read a scene.

    Args:
        path: a cloud in the robot base frame (`SUFFIXES`), or a folder with `cameras.yaml` and its depth images.

    Raises:
        InputError: if it cannot be read, holds no points, or is no such file.
    """
    if path.is_dir():
        return read_views(path)
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: valid clouds are {', '.join(SUFFIXES)}, or a folder with {CAMERAS_FILE}")
    check_scan(path)
    readers = {".ply": _read_ply, ".pcd": _read_pcd, ".npy": _read_npy, ".npz": _read_npz}
    try:
        points = readers[path.suffix.lower()](path)
    except InputError:
        raise
    except Exception as error:  # parsers of damaged files raise whatever they trip over
        raise InputError(
            f"{path} cannot be read as a point cloud ({type(error).__name__}: {error})"
        ) from None
    return cloud_of(points, str(path))


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


def _read_pcd(path: Path) -> Array:
    """Read x, y, z of a PCD file, ascii or binary (format 0.7 of the Point Cloud Library)."""
    file = io.BytesIO(path.read_bytes())
    header = _pcd_header(file, path)
    names, count = header["FIELDS"], int(header["POINTS"][0])
    check_count(count, str(path))
    if not {"x", "y", "z"} <= set(names):
        raise InputError(f"{path} has fields {' '.join(names)}: x, y and z are needed")
    if header["DATA"] == ["ascii"]:
        rows = np.loadtxt(file, ndmin=2, max_rows=count)
        return rows[:, [names.index(axis) for axis in "xyz"]]
    if header["DATA"] != ["binary"]:
        raise InputError(
            f"{path}: PCD data {' '.join(header['DATA'])} is not read: save it as ascii or binary"
        )
    kinds = zip(
        header["TYPE"],
        map(int, header["SIZE"]),
        map(int, header.get("COUNT", ["1"] * len(names))),
        strict=True,
    )
    row = np.dtype([(f"f{i}", _PCD_TYPES[kind, size], (n,)) for i, (kind, size, n) in enumerate(kinds)])
    body = file.read()
    if len(body) < count * row.itemsize:
        raise InputError(f"{path} ends after {len(body) // row.itemsize} of {count} points: it was cut off")
    table = np.frombuffer(body, row, count)
    return np.stack([table[f"f{names.index(axis)}"][:, 0] for axis in "xyz"], axis=1).astype(float)


def _pcd_header(file: IO[bytes], path: Path) -> dict[str, list[str]]:
    fields: dict[str, list[str]] = {}
    for line in islice(file, _PCD_LINES):
        words = line.decode("ascii", "replace").split()
        if words and not words[0].startswith("#"):
            fields[words[0].upper()] = words[1:]
        if "DATA" in fields:
            break
    missing = [key for key in ("FIELDS", "SIZE", "TYPE", "POINTS", "DATA") if not fields.get(key)]
    if missing:
        raise InputError(f"{path} is no PCD file: its header lacks {', '.join(missing)}")
    return fields
