"""A recorded scene read from a file: ply, pcd, xyz, npy or npz, or a folder of depth images with their cameras.

What is read becomes a `Cloud` in the robot base frame, metres, as the simulated cameras make it: everything after this
file is the code that they go through as well.
"""

import io
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import islice
from pathlib import Path
from typing import IO, Annotated, Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, Single
from dexgrasp_env.errors import InputError, first_line
from dexgrasp_env.files import check_bytes, check_file, plain_text, read_npz
from dexgrasp_env.perception.cloud import Cloud, check_count, gather, remove_flying
from dexgrasp_env.robot.camera import Camera, CameraIntrinsics
from dexgrasp_env.valid import Rule, read
from dexgrasp_env.yaml_file import read_yaml

_LINES = 1_000  # of a header
_KINDS = {"F": "f", "I": "i", "U": "u"}  # letters of PCD, and of numpy


def read_pcd(path: Path) -> Array:
    """Return x, y, z (N, 3) of a file, in its unit.

    Raises:
        InputError: for what is no PCD file, lacks coordinates, is cut off or has too many points.
        Exception: whatever else a damaged file makes the parser trip over.
    """
    file = io.BytesIO(plain_text(path.read_bytes()))
    header = _header(file, path)
    names, count, kind = header["FIELDS"], int(header["POINTS"][0]), " ".join(header["DATA"])
    check_count(count, str(path))
    if not {"x", "y", "z"} <= set(names):
        raise InputError(f"{path} has fields {' '.join(names)}: x, y and z are needed")
    columns = [names.index(axis) for axis in "xyz"]
    repeats = [int(number) for number in header.get("COUNT", ["1"] * len(names))]
    if count < 1:
        raise InputError(f"{path} has {count} points: it is empty, or its header is damaged")
    if kind == "ascii":
        table = np.loadtxt(file, ndmin=2, max_rows=count)
        if len(table) < count:
            raise InputError(f"{path} ends after {len(table)} of {count} points: it was cut off")
        return table[:, [sum(repeats[:k]) for k in columns]]
    packed, body = kind == "binary_compressed", file.read()
    if not packed and kind != "binary":
        raise InputError(f"{path}: PCD data {kind!r} is none of ascii, binary and binary_compressed")
    kinds = zip(header["TYPE"], map(int, header["SIZE"]), repeats, strict=True)
    row = np.dtype([(f"f{i}", f"<{_KINDS[letter]}{wide}", (n,)) for i, (letter, wide, n) in enumerate(kinds)])
    size = count * row.itemsize
    check_bytes(size, f"{path} unpacked", ".pcd")
    if packed:  # the fields follow each other, instead of the points
        body = _unpacked(body, size, path)
        row = np.dtype([(name, row[name], (count,)) for name in row.names or ()])
    elif len(body) < size:
        raise InputError(f"{path} ends after {len(body) // row.itemsize} of {count} points: it was cut off")
    records = np.frombuffer(body, row, 1 if packed else count)
    return np.stack([records[f"f{k}"].reshape(count, -1)[:, 0] for k in columns], axis=1).astype(float)


def _unpacked(body: bytes, size: int, path: Path) -> bytes:
    """Return `size` bytes that were packed by LZF."""
    import lzf

    packed, whole = np.frombuffer(body, "<u4", 2).tolist()
    try:
        data = lzf.decompress(body[8 : 8 + packed], size)
    except ValueError:
        data = None
    if data is None or len(data) != size or whole != size:
        raise InputError(f"{path}: its compressed points are damaged or cut off")
    return bytes(data)


def _header(file: IO[bytes], path: Path) -> dict[str, list[str]]:
    fields: dict[str, list[str]] = {}
    for line in islice(file, _LINES):
        words = line.decode("ascii", "replace").split()
        if words and not words[0].startswith("#"):
            fields[words[0].upper()] = words[1:]
        if "DATA" in fields:
            break
    missing = [key for key in ("FIELDS", "SIZE", "TYPE", "POINTS", "DATA") if not fields.get(key)]
    if missing:
        raise InputError(f"{path} is no PCD file: its header lacks {', '.join(missing)}")
    return fields


CAMERAS_FILE = "cameras.yaml"


def check_scan(path: Path) -> None:
    """Raise `InputError` where a file cannot be read, is none, is empty, or is too large for a scan."""
    try:
        if not check_file(path):
            raise InputError(f"{path} is empty: record it again")
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None


@contextmanager
def understood(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever a parser raises on a damaged file into one line.

    Raises:
        InputError: for any error within.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise InputError(
            f"{path} cannot be read as {kind} ({type(error).__name__}: {first_line(error)})"
        ) from None


def _inside(value: Any) -> str:
    if not value or Path(value).is_absolute() or ".." in Path(value).parts:
        raise ValueError
    return str(value)


@dataclass(frozen=True, eq=False)
class DepthImage:
    """An image and its camera, as `cameras.yaml` has them; see `read_cameras`."""

    depth: Annotated[str, Rule("the name of a file of the same folder", _inside)]
    width: float
    height: float
    fx: float
    fy: float
    cx: float
    cy: float
    T_base_camera: Annotated[Array, Rule("4 x 4 numbers", lambda value: np.asarray(value, dtype=float))]
    name: Annotated[str, Rule("text", str)] = ""
    depth_scale: float | None = None

    @cached_property
    def camera(self) -> Camera:
        """The camera, in the frame of the robot's base."""
        lens = CameraIntrinsics(int(self.width), int(self.height), self.fx, self.fy, self.cx, self.cy)
        return Camera(self.name or self.depth, self.T_base_camera, lens)

    def read(self, folder: Path) -> Single:
        """Return the depth (H, W) m."""
        path, lens = folder / self.depth, self.camera.intrinsics
        check_scan(path)
        scale = self.depth_scale
        if scale is None:
            scale = 0.001 if path.suffix.lower() == ".png" else 1.0
        with understood(path, "a depth image"):
            image = _array(path)
            if image.shape != (lens.height, lens.width):
                raise InputError(
                    f"{path} is {image.shape}: its camera says {lens.height} rows of {lens.width} pixels"
                )
            check_count(image.size, str(path))
            return (np.asarray(image, dtype=float) * scale).astype(np.float32)


def _array(path: Path) -> NDArray[Any]:
    if path.suffix.lower() == ".npy":
        return np.load(path, mmap_mode="r", allow_pickle=False)
    import imageio.v3 as iio

    return iio.imread(path)


def read_views(folder: Path) -> Cloud:
    """Merge the depth images that `cameras.yaml` of a folder names; see `read_cameras`."""
    clouds, shapes, first = list[Cloud](), list[tuple[int, ...]](), 0
    for k, image in enumerate(read_cameras(folder / CAMERAS_FILE)):
        depth = image.read(folder)
        seen = gather(remove_flying(depth[None]), (image.camera,))
        clouds.append(replace(seen, camera=seen.camera + np.int32(k), pixel=seen.pixel + np.int32(first)))
        check_count(sum(map(len, clouds)), str(folder))
        shapes, first = [*shapes, depth.shape], first + depth.size
    shape = (len(shapes), *shapes[0]) if len(set(shapes)) == 1 else (first,)
    merged = replace(Cloud.join(clouds), shape=shape)
    if not len(merged):
        raise InputError(f"{folder}: no depth image holds a measurement")
    return merged


def read_cameras(path: Path) -> list[DepthImage]:
    """Read which depth images there are, and their cameras.

    The file is YAML: `cameras:` a list of `name`, `depth` (a file: npy, or 16-bit png), `depth_scale` (metres a unit;
    1 for npy, 0.001 for png), `width`, `height`, `fx`, `fy`, `cx`, `cy` (pixels), and `T_base_camera`, the 4 x 4 pose
    of the optical frame (x right, y down, z forward) in the robot base frame, metres.

    Raises:
        InputError: naming the camera and the field that is unknown, missing or wrong (lens distortion is not applied).
    """
    content = read_yaml(path)
    entries = content.get("cameras") if isinstance(content, dict) else None
    if not isinstance(entries, list) or not entries:
        raise InputError(f"{path}: valid is a mapping with `cameras`, a list of one or more")
    return [read(DepthImage, entry, f"{path}: camera {k}") for k, entry in enumerate(entries)]


UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}


def read_scan(path: Path, unit: str = "m") -> Cloud:
    """Read a scene.

    Args:
        path: a cloud in the robot base frame (`READERS`), or a folder with `cameras.yaml` and its depth images.
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
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path}: valid clouds are {', '.join(READERS)}, or a folder with {CAMERAS_FILE}")
    check_scan(path)
    with understood(path, "a point cloud"):
        points = reader(path)
    cloud = cloud_of(points, str(path))
    return cloud.moved(cloud.points * UNITS[unit])


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
    n = len(known)
    if not n:
        raise InputError(f"{source} holds no finite point")
    up, shape = np.tile([0.0, 0.0, 1.0], (n, 1)), rows.shape[:1]
    return Cloud(np.ascontiguousarray(rows[known]), up, np.ones(n), np.zeros(n, np.int32), known, shape)


def _read_ply(path: Path) -> Array:
    import trimesh

    loaded = trimesh.load(io.BytesIO(plain_text(path.read_bytes())), file_type="ply", process=False)
    vertices = getattr(loaded, "vertices", None)
    if vertices is None or not len(vertices):
        raise InputError(f"{path} holds no vertices")
    return np.asarray(vertices, dtype=float)


def _read_npz(path: Path) -> NDArray[Any]:
    arrays = read_npz(path)
    name = "points" if "points" in arrays else next(iter(arrays)) if len(arrays) == 1 else None
    if name is None:
        raise InputError(f"{path} has arrays {', '.join(arrays) or 'none'}: name the cloud 'points'")
    return arrays[name]


def _read_xyz(path: Path) -> Array:
    """Read rows of x, y, z and whatever follows, apart by blanks, commas or semicolons.

    Remarks (`#`, `//`), the names of columns and a count may stand above them, as CloudCompare writes them.
    """
    lines = plain_text(path.read_bytes()).decode("utf-8", "replace").splitlines()
    if _DECIMAL_COMMAS.match(next(filter(_is_row, lines), "")):
        lines = [line.replace(",", ".") for line in lines]
    start = next((k for k, line in enumerate(lines[:_LINES]) if _is_row(line)), 0)
    rows = (line.replace(",", " ").replace(";", " ") for line in lines[start:])
    return np.loadtxt(rows, ndmin=2, usecols=(0, 1, 2), comments=("#", "//"))


def _is_row(line: str) -> bool:
    """Tell a row of coordinates from what may stand above it."""
    words = line.replace(",", " ").replace(";", " ").split()[:3]
    try:
        return len([float(word) for word in words]) == 3
    except ValueError:
        return False


_DECIMAL_COMMAS = re.compile(r"\s*-?\d+,\d+(\s*;\s*|\s+)-?\d+,\d+(\s*;\s*|\s+)-?\d+,\d+")
"""A row whose numbers have commas for points; what is apart by commas alone has none between its digits and blanks."""


READERS: dict[str, Callable[[Path], NDArray[Any]]] = {
    ".ply": _read_ply, ".pcd": read_pcd, ".xyz": _read_xyz,
    ".npy": partial(np.load, allow_pickle=False), ".npz": _read_npz,
}  # fmt: skip
"""What reads clouds, by the ending of their files."""
