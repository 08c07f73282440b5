"""A folder of depth images with their calibrated cameras, merged into one cloud."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.errors import InputError
from dexgrasp_env.files import read_yaml
from dexgrasp_env.perception.cloud import Cloud, gather, remove_flying
from dexgrasp_env.robot.camera import Camera, CameraIntrinsics

CAMERAS_FILE = "cameras.yaml"
_MOST_BYTES = 2**30  # a file larger than this is no scan of a table


def check_file(path: Path) -> None:
    """Raise `InputError` where a file cannot be read, is empty, or is too large for a scan."""
    try:
        size = path.stat().st_size
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None
    if size == 0 or size > _MOST_BYTES:
        raise InputError(f"{path} has {size} bytes: valid are files of up to 1 GiB with points in them")


def read_views(folder: Path) -> Cloud:
    """Merge the depth images that `cameras.yaml` of a folder names; see `read_cameras`."""
    cameras, files, scales = read_cameras(folder / CAMERAS_FILE)
    clouds = []
    for k, (camera, file, scale) in enumerate(zip(cameras, files, scales, strict=True)):
        depth = _read_depth(folder / file, camera, scale)
        seen = gather(remove_flying(depth[None]), (camera,))
        tags = np.full(len(seen), k, np.int32)
        clouds.append(Cloud(seen.points, seen.views, seen.depth, tags, seen.pixel))
    merged = Cloud.join(clouds)
    if not len(merged):
        raise InputError(f"{folder}: no depth image holds a measurement")
    return merged


def read_cameras(path: Path) -> tuple[tuple[Camera, ...], list[str], list[float]]:
    """Read cameras, the names of their depth images, and the factors from their values to metres.

    The file is YAML: `cameras:` a list of `name`, `depth` (a file: npy, or 16-bit png), `depth_scale` (metres a unit;
    1 for npy, 0.001 for png), `width`, `height`, `fx`, `fy`, `cx`, `cy` (pixels), and `T_base_camera`, the 4 x 4 pose
    of the optical frame (x right, y down, z forward) in the robot base frame, metres.

    Raises:
        InputError: naming the camera and the field that is missing or wrong.
    """
    content = read_yaml(path)
    entries = content.get("cameras") if isinstance(content, dict) else None
    if not isinstance(entries, list) or not entries:
        raise InputError(f"{path}: valid is a mapping with `cameras`, a list of one or more")
    cameras, files, scales = [], [], []
    for number, entry in enumerate(entries):
        where = f"{path}: camera {number}"
        if not isinstance(entry, dict):
            raise InputError(f"{where} is no mapping of settings")
        needed = ("depth", "width", "height", "fx", "fy", "cx", "cy", "T_base_camera")
        missing = [key for key in needed if key not in entry]
        if missing:
            raise InputError(f"{where} lacks {', '.join(missing)}")
        cameras.append(_camera(entry, where))
        files.append(_inside(str(entry["depth"]), where))
        default = 0.001 if files[-1].lower().endswith(".png") else 1.0
        scales.append(_number(entry.get("depth_scale", default), f"{where}: depth_scale"))
    return tuple(cameras), files, scales


def _camera(entry: dict[str, Any], where: str) -> Camera:
    values = {
        key: _number(entry[key], f"{where}: {key}") for key in ("width", "height", "fx", "fy", "cx", "cy")
    }
    try:
        T = np.asarray(entry["T_base_camera"], dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{where}: T_base_camera must be 4 x 4 numbers") from None
    lens = CameraIntrinsics(
        int(values["width"]), int(values["height"]), values["fx"], values["fy"], values["cx"], values["cy"]
    )
    return Camera(str(entry.get("name", where)), T, lens)


def _inside(name: str, where: str) -> str:
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise InputError(f"{where}: depth {name!r} must be a file of the same folder")
    return name


def _number(value: Any, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise InputError(f"{what} is {value!r}: valid is a finite number")
    return float(value)


def _read_depth(path: Path, camera: Camera, scale: float) -> NDArray[np.float32]:
    check_file(path)
    try:
        if path.suffix.lower() == ".npy":
            image = np.load(path, allow_pickle=False)
        else:
            import imageio.v3 as iio

            image = iio.imread(path)
        depth = np.asarray(image, dtype=float) * scale
    except Exception as error:
        raise InputError(f"{path} cannot be read as a depth image ({type(error).__name__})") from None
    wanted = (camera.intrinsics.height, camera.intrinsics.width)
    if depth.shape != wanted:
        raise InputError(f"{path} is {depth.shape}: its camera says {wanted[0]} rows of {wanted[1]} pixels")
    return depth.astype(np.float32)
