"""Selection of the object that is meant: near a point, in a box, behind a pixel, under a mask."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp_env.arrays import Array, Mask, middle
from dexgrasp_env.errors import InputError, understood, unknown_name
from dexgrasp_env.perception.camera_files import CAMERAS_FILE, read_cameras
from dexgrasp_env.perception.cloud import WORKSPACE_HIGH, WORKSPACE_LOW, Cloud, deproject, inside
from dexgrasp_env.perception.cloud_files import check_scan
from dexgrasp_env.perception.detected import in_words
from dexgrasp_env.perception.reasons import NoTargetError
from dexgrasp_env.poses import placed

_NEAR = 0.08  # m from the named point to the object


@dataclass(frozen=True, eq=False)
class TargetSelector:
    """The object that is meant; with nothing said, the only one.

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

    @property
    def points(self) -> bool:
        """True where something is pointed at."""
        return not (self.near is None and self.box is None and self.mask is None)

    def moved(self, by: Array) -> "TargetSelector":
        """Return it in a frame in which points lie `by` (3,) m elsewhere."""
        near, box = (None if place is None else place + by for place in (self.near, self.box))
        return replace(self, near=near, box=box)

    def placed(self, cloud: Cloud, T: Array) -> "TargetSelector":
        """Return it in a frame in which that of a cloud has pose `T` (4, 4); a box becomes a mask of what it holds."""
        near, mask = None if self.near is None else placed(T, self.near), self.mask
        if self.box is not None:
            mask = np.zeros(np.prod(cloud.shape, dtype=int), bool)
            mask[cloud.pixel[self.marks(cloud)]] = True
        return TargetSelector(near, None, mask)

    def meant(self, cloud: Cloud) -> Mask | None:
        """Return which points of a cloud are pointed at (M,), as far as it is known; None where nothing is."""
        if self.near is not None:
            return np.asarray(np.linalg.norm(cloud.points - self.near, axis=1) < _NEAR)
        return self.marks(cloud)

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

    def choose(self, found: Sequence[Cloud], points: int, T_base_world: Array) -> int:
        """Return the index of the object that is near the point, or the only one in the workspace.

        Args:
            found: the objects.
            points: number above the table, for people.
            T_base_world: (4, 4), for people.

        Raises:
            NoTargetError: where there is none, none near, or several.
        """
        if not found:
            raise NoTargetError("no_object_on_the_table", f"{points} points above the table")
        reachable = [k for k, one in enumerate(found) if _is_in_reach(one)]
        reachable = [k for k in reachable if _may_be_meant(found[k])] or reachable
        if self.near is not None:
            gaps = [np.linalg.norm(one.points - self.near, axis=1).min() for one in found]
            best = int(np.argmin(gaps))
            if gaps[best] > _NEAR:
                raise NoTargetError(
                    "nothing_near_the_point", f"the nearest is {100 * gaps[best]:.0f} cm away"
                )
        elif len(reachable) > 1:
            raise NoTargetError("several_objects", _places([found[k] for k in reachable], T_base_world))
        else:
            best = reachable[0] if reachable else 0
        check_reach(found[best], T_base_world)
        return best


def check_reach(cloud: Cloud, T_base_world: Array) -> None:
    """Raise `NoTargetError` for an object outside the workspace of the arm."""
    if not _is_in_reach(cloud):
        raise NoTargetError("out_of_reach", _places([cloud], T_base_world))


def _is_in_reach(cloud: Cloud) -> bool:
    """Return True for what stands in the workspace; what begins above it stands on nothing."""
    level = inside(middle(cloud.points[:, :2])[None], WORKSPACE_LOW[:2], WORKSPACE_HIGH[:2]).all()
    return bool(level and cloud.points[:, 2].min() < WORKSPACE_HIGH[2])


def _may_be_meant(cloud: Cloud) -> bool:
    """Return False for what no hand grasps: boards, bins, films of the table's noise, what hangs on furniture."""
    low, high = np.quantile(cloud.points[:, 2], (0.02, 0.98))
    width = np.ptp(cloud.points[:, :2], axis=0).min()
    return bool(high > 0.010 and low < 0.20 and width < (0.15 if high < 0.04 else 0.22))  # m


def _places(found: list[Cloud], T_base_world: Array) -> str:
    """Return for people where things are and how large, the first few."""
    said = [
        in_words(placed(T_base_world, middle(one.points)), np.ptp(one.points, axis=0)) for one in found[:8]
    ]
    return "; ".join(said) + ("; ..." if len(found) > 8 else "")


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
        kind = "nothing" if values is None else array.dtype
        raise InputError(f"a mask holds bool or whole numbers, not {kind}")
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
    """Read a mask from an npy file or an image without colours; see `mask_of`."""
    check_scan(path)
    with understood(path, "a mask: valid is a .npy file, or a .png of one channel"):
        if path.suffix.lower() == ".npy":
            values = np.load(path, allow_pickle=False)
        else:
            from PIL import Image

            values = np.asarray(Image.open(path))  # of a palette the numbers
    if path.suffix.lower() != ".npy" and values.ndim > 2:
        if np.ptp(values[..., :3], axis=-1).any():
            raise InputError(
                f"{path} has colours: valid is an image of one channel, 0 where the object is not"
            )
        values = values[..., 0]
    return mask_of(values, label)


def point_of_pixel(folder: Path, camera: str, u: int, v: int, T_base_camera: Array | None = None) -> Array:
    """Return the point (3,) m, frame of the robot's base, that a recorded camera sees at column `u` of row `v`.

    The camera's pose (4, 4) is given where its file has none.

    Raises:
        InputError: where there is no such camera or pixel, or no depth there.
    """
    if not folder.is_dir():
        raise InputError(
            f"a pixel points in a folder with {CAMERAS_FILE}: {folder} is none; valid there is a mask"
        )
    images = {image.camera.name: image for image in read_cameras(folder / CAMERAS_FILE, T_base_camera)}
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
