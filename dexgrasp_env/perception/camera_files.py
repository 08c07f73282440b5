"""Cameras of recorded depth images: `cameras.yaml` of a folder, ROS's CameraInfo, lens distortion."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, Fields, Single
from dexgrasp_env.errors import InputError, understood
from dexgrasp_env.perception.camera_pose import POSE
from dexgrasp_env.perception.cloud import check_count, is_valid
from dexgrasp_env.perception.cloud_files import check_scan
from dexgrasp_env.robot.camera import Camera, CameraIntrinsics
from dexgrasp_env.valid import Rule, check, number, read, several
from dexgrasp_env.yaml_file import read_yaml

CAMERAS_FILE = "cameras.yaml"
_LENS = ("fx", "fy", "cx", "cy")
_OF_ROS = {
    "image_width": "width",
    "image_height": "height",
    "camera_name": "name",
    "camera_matrix": "K",
    "k": "K",
    "distortion_coefficients": "distortion",
    "d": "distortion",
    "D": "distortion",
    "r": "R",
    "rectification_matrix": "R",
    "p": "P",
    "projection_matrix": "P",
}
"""Keys of ROS's CameraInfo, as messages and as calibration files have them -> ours."""
_MODELS = ("", "plumb_bob", "rational_polynomial")  # of distortion that are undone


def _inside(value: Any) -> str:
    if not value or Path(value).is_absolute() or ".." in Path(value).parts:
        raise ValueError
    return str(value)


_FILE = Rule("the name of a file of the same folder", _inside)


def _coefficients(value: Any) -> tuple[float, ...]:
    found = several(number()).validate(list(_data(value)))
    if (len(found) > 8 and any(found[8:])) or len(found) not in (0, 4, 5, 8, 12, 14):
        raise ValueError
    return found[:8]


def _data(value: Any) -> Any:
    """Return the numbers of a matrix as ROS writes it, a mapping with `rows`, `cols` and `data`."""
    return value.get("data") if isinstance(value, Mapping) else value


def _intrinsic(value: Any) -> Array:
    """Return K (3, 3) without skew."""
    K = np.array(_data(value), dtype=float).reshape(3, 3)
    if K[[0, 1, 2, 2, 2], [1, 0, 0, 1, 2]].tolist() != [0.0, 0.0, 0.0, 0.0, 1.0]:
        raise ValueError
    return K


def _admitted(valid: Callable[[Any], Any], value: Any) -> Any:
    if not valid(value):
        raise ValueError
    return value


_K = Rule("3 x 3 numbers fx, 0, cx, 0, fy, cy, 0, 0, 1", _intrinsic)
_BINNED = "0 or 1: images of another size need their own K", lambda value: value in (0, 1)
_PLAIN: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "R": ("the unit matrix: rectify the image", lambda R: np.allclose(np.ravel(_data(R)), np.eye(3).ravel())),
    "binning_x": _BINNED,
    "binning_y": _BINNED,
    "roi": ("the whole image", lambda roi: not (roi.get("x_offset") or roi.get("y_offset"))),
    "header": ("anything", lambda header: True),
    "P": ("anything", lambda P: True),
}
"""Keys of a CameraInfo beside K and distortion, which say how the image was taken -> what they have to be."""


@dataclass(frozen=True)
class Lens(CameraIntrinsics):
    """A pinhole camera with the distortion of a lens, after Brown and Conrady.

    Attributes:
        distortion: k1, k2, p1, p2, k3, k4, k5, k6 in OpenCV's order, or the first of them.
    """

    distortion: tuple[float, ...] = ()

    def directions(self) -> Array:
        """Rays of the pixels, (H, W, 3) at z = 1, the distortion undone.

        Raises:
            InputError: where the distortion is so strong that it cannot be undone.
        """
        rays = super().directions()
        if not any(self.distortion):
            return rays
        seen = rays[..., :2].copy()
        for _ in range(50):
            scale, shift = self._bent(rays[..., :2])
            rays[..., :2] = (seen - shift) / scale
        scale, shift = self._bent(rays[..., :2])
        if not (np.abs(rays[..., :2] * scale + shift - seen) < 1e-4).all():  # focal lengths
            raise InputError(f"distortion {self.distortion} folds the image: check its coefficients")
        return rays

    def _bent(self, xy: Array) -> tuple[Array, Array]:
        """Return the radial factor (..., 1) and the tangential shift (..., 2) of points at z = 1 (..., 2)."""
        k1, k2, p1, p2, k3, k4, k5, k6 = (*self.distortion, *[0.0] * (8 - len(self.distortion)))
        r2 = (xy**2).sum(-1, keepdims=True)
        scale = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        p = np.array([p2, p1])
        return scale, 2.0 * xy[..., :1] * xy[..., 1:] * p[::-1] + p * (r2 + 2.0 * xy**2)


@dataclass(frozen=True, eq=False)
class DepthImage:
    """An image and its camera, as `cameras.yaml` has them; see `read_cameras`."""

    depth: Annotated[str, _FILE]
    width: float
    height: float
    fx: float
    fy: float
    cx: float
    cy: float
    T_base_camera: Annotated[Array, POSE]
    name: Annotated[str, Rule("text", str)] = ""
    depth_scale: float | None = None
    distortion: Annotated[
        tuple[float, ...],
        Rule("4, 5 or 8 numbers k1, k2, p1, p2, k3, k4, k5, k6 (of a prism, or tilted: none)", _coefficients),
    ] = ()
    distortion_model: str = ""

    def __post_init__(self) -> None:
        if self.distortion_model not in _MODELS and any(self.distortion):
            raise InputError(
                f"distortion_model {self.distortion_model!r} is not undone: valid are {', '.join(_MODELS[1:])}; "
                "of others rectify the images first"
            )

    @cached_property
    def camera(self) -> Camera:
        """The camera, in the frame of the robot's base."""
        size, lens = (int(self.width), int(self.height)), (self.fx, self.fy, self.cx, self.cy)
        return Camera(self.name or self.depth, self.T_base_camera, Lens(*size, *lens, self.distortion))

    def read(self, folder: Path) -> Single:
        """Return the depth (H, W) m."""
        path, lens = folder / self.depth, self.camera.intrinsics
        check_scan(path)
        with understood(path, "a depth image"):
            image = _array(path)
            if image.shape != (lens.height, lens.width):
                raise InputError(
                    f"{path} is {image.shape}: its camera says {lens.height} rows of {lens.width} pixels"
                )
            check_count(image.size, str(path))
            scale = self.depth_scale or (1.0 if image.dtype.kind == "f" else 0.001)
            depth = (np.asarray(image, dtype=float) * scale).astype(np.float32)
        far = float(np.median(depth[is_valid(depth)])) if is_valid(depth).any() else 0.0
        if far > 20.0:  # m: the unit is another
            raise InputError(
                f"{path} is {far:.0f} m away in the median: depth_scale in {CAMERAS_FILE} is metres a unit, 0.001 for "
                "millimetres"
            )
        return depth


def _array(path: Path) -> NDArray[Any]:
    if path.suffix.lower() == ".npy":
        return np.load(path, mmap_mode="r", allow_pickle=False)
    import imageio.v3 as iio

    return iio.imread(path)


def read_cameras(path: Path, T_base_camera: Array | None = None) -> list[DepthImage]:
    """Read which depth images there are, and their cameras.

    The file is YAML: `cameras:` a list of `name`, `depth` (a file: npy, or 16-bit png), `depth_scale` (metres a unit;
    1 for floating point, 0.001 for whole numbers), `width`, `height`, `fx`, `fy`, `cx`, `cy` (pixels) or in their place
    `K` (3 x 3), `distortion` with its `distortion_model`, and `T_base_camera`, the pose of the optical frame (x right,
    y down, z forward) in the robot base frame, metres, see `camera_pose`. Instead of the lens an entry, or the whole
    file, may hold a CameraInfo of ROS, or name its file in `camera_info`; then K and its distortion are used.

    Args:
        path: of the file.
        T_base_camera: (4, 4) pose of the one camera, where the file has none.

    Raises:
        InputError: naming the camera and the field that is unknown, missing or wrong.
    """
    content = read_yaml(path)
    entries = content.get("cameras", [content]) if isinstance(content, dict) else None
    if not isinstance(entries, list) or not entries or not content:
        raise InputError(f"{path}: valid is a mapping with `cameras`, a list of one or more")
    found = []
    for k, entry in enumerate(entries):
        what = f"{path}: camera {k}"
        plain = _plain(entry, path.parent, what) if isinstance(entry, Mapping) else entry
        if T_base_camera is not None and isinstance(plain, dict):
            if len(entries) > 1 or "T_base_camera" in plain:
                raise InputError(f"{path} says where its cameras are: leave --camera-pose out")
            plain["T_base_camera"] = T_base_camera
        elif isinstance(plain, dict) and "T_base_camera" not in plain and plain.keys() & {"depth", "fx"}:
            raise InputError(f"{what} T_base_camera is missing: state it there, or by --camera-pose")
        found.append(read(DepthImage, plain, what))
    return found


def _plain(entry: Mapping[str, Any], folder: Path, what: str) -> Fields:
    """Return an entry with what a CameraInfo says in our words."""
    given = dict(entry)
    info = given.pop("camera_info", {})
    if isinstance(info, str):
        info = read_yaml(folder / check(f"{what} camera_info", info, _FILE))
    if not isinstance(info, Mapping):
        raise InputError(f"{what} camera_info: valid is a CameraInfo, or the name of its file")
    plain = Fields()
    for key, value in (*given.items(), *info.items()):
        own = str(_OF_ROS.get(key, key))
        if own in plain:
            raise InputError(f"{what} has {own} twice, once as {key}")
        plain[own] = value
    if "K" in plain:
        if both := [key for key in _LENS if key in plain]:
            raise InputError(f"{what} has K and {', '.join(both)}: give one of them")
        plain |= zip(
            _LENS, check(f"{what} K", plain.pop("K"), _K)[[0, 1, 0, 1], [0, 1, 2, 2]].tolist(), strict=True
        )
    for key in _PLAIN.keys() & plain.keys():
        words, valid = _PLAIN[key]
        check(f"{what} {key}", plain.pop(key), Rule(words, partial(_admitted, valid)))
    if "depth" not in plain and (
        images := sorted(p.name for p in folder.iterdir() if p.suffix in (".npy", ".png", ".tif", ".tiff"))
    ):
        if len(images) > 1:
            raise InputError(f"{what} depth is missing: which of {', '.join(images)}?")
        plain["depth"] = images[0]
    return plain
