"""Which object of a scene is meant: near a point, in a box, behind a pixel, under a mask."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp_env.arrays import Array, Mask
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.perception.cloud import Cloud, deproject, inside
from dexgrasp_env.perception.scan import CAMERAS_FILE, check_scan, read_cameras, understood


@dataclass(frozen=True, eq=False)
class Pointing:
    """Which object is meant; with nothing said, the only one.

    Attributes:
        near: (3,) m, a point near it.
        box: (2, 3) m, lowest and highest corner of a box around it.
        mask: one bool for each row or pixel that the cloud was made from: where it is seen.
    """

    near: Array | None = None
    box: Array | None = None
    mask: Mask | None = None

    def __post_init__(self) -> None:
        if sum(value is not None for value in (self.near, self.box, self.mask)) > 1:
            raise InputError("point at the object in one way: near it, by a box, by a mask or by a pixel")
        if self.box is not None and not (self.box[0] < self.box[1]).all():
            raise InputError(
                "the box is empty: valid is X0 Y0 Z0 X1 Y1 Z1 with each of the first below its second"
            )

    def moved(self, by: Array) -> "Pointing":
        """Return it in a frame in which points lie `by` (3,) m elsewhere."""
        near, box = (None if place is None else place + by for place in (self.near, self.box))
        return replace(self, near=near, box=box)

    def turned(self, cloud: Cloud, R: Array, about: Array) -> "Pointing":
        """Return it for a cloud that is turned about a point (3,) m; a box becomes a mask of what it holds."""
        near = None if self.near is None else (self.near - about) @ R.T + about
        mask = self.mask
        if self.box is not None:
            mask = np.zeros(np.prod(cloud.shape, dtype=int), bool)
            mask[cloud.pixel[self.marks(cloud)]] = True
        return Pointing(near, None, mask)

    def marks(self, cloud: Cloud) -> Mask | None:
        """Return which points of a cloud are marked by box or mask (M,); None where neither is given.

        Raises:
            InputError: for a mask of another shape than the cloud's images or rows.
        """
        if self.mask is not None:
            if np.size(self.mask) != np.prod(cloud.shape, dtype=int):
                raise InputError(
                    f"the mask has shape {np.shape(self.mask)}: "
                    f"valid is one value each of {' x '.join(map(str, cloud.shape))}"
                )
            return np.asarray(self.mask, dtype=bool).ravel()[cloud.pixel]
        if self.box is not None:
            return inside(cloud.points, *self.box)
        return None


def mask_of(values: Any, label: int | None = None) -> Mask:
    """Return where a mask says that the object is.

    Args:
        values: bool, or whole numbers, 0 being nothing; any shape.
        label: the object's number; None where there is but one.

    Raises:
        InputError: for values that are no mask, a label that is not in it, or one that is needed.
    """
    array = np.asarray(values)
    if array.dtype == bool:
        array = array.astype(int)
    if array.dtype.kind not in "iu":
        raise InputError(f"a mask holds bool or whole numbers, not {array.dtype}")
    found = np.unique(array[array != 0]).tolist()
    if label is None and len(found) == 1:
        label = found[0]
    if not found:
        raise InputError("the mask is empty: it marks no point")
    if label not in found:
        named = ", ".join(map(str, found[:12])) + (", ..." if len(found) > 12 else "")
        said = "the mask has several labels" if label is None else f"the mask has no label {label}"
        raise InputError(f"{said}: valid are {named}")
    return np.asarray(array == label)


def read_mask(path: Path, label: int | None = None) -> Mask:
    """Read a mask from an npy file; see `mask_of`."""
    check_scan(path)
    with understood(path, "a mask: valid is a .npy file"):
        values = np.load(path, allow_pickle=False)
    return mask_of(values, label)


def point_of_pixel(folder: Path, camera: str, u: int, v: int) -> Array:
    """Return the point (3,) m, frame of the robot's base, that a recorded camera sees at column `u` of row `v`.

    Raises:
        InputError: where there is no such camera or pixel, or no depth there.
    """
    if not folder.is_dir():
        raise InputError(
            f"a pixel points in a folder with {CAMERAS_FILE}: {folder} is none; valid there is a mask"
        )
    images = {image.camera.name: image for image in read_cameras(folder / CAMERAS_FILE)}
    if camera not in images:
        raise unknown_name("camera", camera, images)
    image = images[camera]
    lens = image.camera.intrinsics
    if not (0 <= u < lens.width and 0 <= v < lens.height):
        raise InputError(
            f"pixel {u} {v} is outside camera {camera}: valid is 0 0 to {lens.width - 1} {lens.height - 1}"
        )
    point = deproject(image.read(folder), image.camera)[v, u]
    if not np.isfinite(point).all():
        raise InputError(f"camera {camera} has no depth at pixel {u} {v}: point at one beside it")
    return point
