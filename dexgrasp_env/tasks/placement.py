"""Where the object is put at reset."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.objects.rest_poses import rest_poses
from dexgrasp_env.poses import quat_multiply, yaw_quat
from dexgrasp_env.tasks.constants import PLACE_X, PLACE_Y, PLACE_YAW

_CLEARANCE = 0.0005  # m above the table; the settle closes it


@dataclass(frozen=True)
class Placement:
    """Ranges that the object's pose is drawn from, in the robot base frame.

    Attributes:
        x: range of the centre, m.
        y: range of the centre, m.
        yaw: range of the turn about z, rad.
        rest_pose: `"any"` draws a rest pose by its probability, `"likely"` takes the most probable, a number takes that
            one; objects of the catalogue with a fixed presentation ignore it.
    """

    x: tuple[float, float] = PLACE_X
    y: tuple[float, float] = PLACE_Y
    yaw: tuple[float, float] = PLACE_YAW
    rest_pose: str | int = "any"

    @classmethod
    def of(cls, value: "Placement | Mapping[str, Any] | None") -> "Placement":
        """Return a placement from a mapping of its attributes.

        Raises:
            InputError: for an unknown key, or a range that is not two increasing finite numbers.
        """
        if value is None or isinstance(value, Placement):
            return value or cls()
        names = [field.name for field in fields(cls)]
        for key in value:
            if key not in names:
                raise unknown_name("object_pose key", key, names)
        ranges = {key: check_range(f"object_pose {key}", value[key]) for key in value if key != "rest_pose"}
        rest_pose = value.get("rest_pose", "any")
        if not (rest_pose in ("any", "likely") or (isinstance(rest_pose, int) and rest_pose >= 0)):
            raise unknown_name("rest_pose", rest_pose, ["any", "likely", "0", "1", "..."])
        return cls(**ranges, rest_pose=rest_pose)

    def sample(self, model: ObjectModel, rng: Generator) -> NDArray[np.float64]:
        """Draw a pose (7,): position m and quaternion wxyz."""
        u = rng.random(4)  # always four numbers: one setting does not shift the draws of another
        x, y, yaw = (low + (high - low) * u[i] for i, (low, high) in enumerate((self.x, self.y, self.yaw)))
        quat, height = self._rest(model, u[3])
        return np.array([x, y, height + _CLEARANCE, *quat_multiply(yaw_quat(yaw), quat)])

    def _rest(self, model: ObjectModel, u: float) -> tuple[NDArray[np.float64], float]:
        if model.fixed_pose is not None:
            return fixed_rest(model)
        poses = rest_poses(model)
        if isinstance(self.rest_pose, int):
            if self.rest_pose >= len(poses):
                valid = f"valid are 0..{len(poses) - 1}"
                raise InputError(f"rest_pose {self.rest_pose}: {model.name} has {len(poses)}, {valid}")
            pose = poses[self.rest_pose]
        elif self.rest_pose == "likely":
            pose = max(poses, key=lambda p: p.probability)
        else:
            total = np.cumsum([p.probability for p in poses])
            pose = poses[int(np.searchsorted(total, u * total[-1], side="right").clip(0, len(poses) - 1))]
        return np.asarray(pose.quat_wxyz), float(pose.height)


def fixed_rest(model: ObjectModel) -> tuple[NDArray[np.float64], float]:
    """Return quaternion and centre height of the pose that the catalogue presents an object in."""
    from dexgrasp_env.poses import rotate

    quat = np.asarray(model.fixed_pose, dtype=float)
    return quat, float(-rotate(quat, np.asarray(model.mesh.vertices))[:, 2].min())


def check_range(name: str, value: Any) -> tuple[float, float]:
    """Return `value` as two increasing finite floats.

    Raises:
        InputError: if it is anything else.
    """
    try:
        low, high = (float(v) for v in value)
    except (TypeError, ValueError):
        raise InputError(f"{name} = {value!r}: valid is a pair of numbers, low and high") from None
    if not (np.isfinite([low, high]).all() and low <= high):
        raise InputError(f"{name} = {value!r}: valid is low <= high, both finite")
    return low, high
