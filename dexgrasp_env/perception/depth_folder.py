"""A folder of depth images with their calibrated cameras, merged into one cloud."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import read_yaml
from dexgrasp_env.perception.cloud import Cloud, gather, remove_flying
from dexgrasp_env.robot.camera import Camera, CameraIntrinsics
from dexgrasp_env.valid import Rule, read

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
    found = [read(_Entry, entry, f"{path}: camera {k}", more=True) for k, entry in enumerate(entries)]
    cameras = [
        Camera(e.name or f"{path}: camera {k}", e.T_base_camera, e.intrinsics) for k, e in enumerate(found)
    ]
    return tuple(cameras), [e.depth for e in found], [e.scale for e in found]


def _inside(value: Any) -> str:
    if not value or Path(value).is_absolute() or ".." in Path(value).parts:
        raise ValueError
    return str(value)


@dataclass(frozen=True, eq=False)
class _Entry:
    """A camera as the file names it."""

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

    @property
    def intrinsics(self) -> CameraIntrinsics:
        return CameraIntrinsics(int(self.width), int(self.height), self.fx, self.fy, self.cx, self.cy)

    @property
    def scale(self) -> float:
        if self.depth_scale is not None:
            return self.depth_scale
        return 0.001 if self.depth.lower().endswith(".png") else 1.0


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
