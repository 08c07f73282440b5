"""Initial poses of the object: the ranges that they are drawn from, and checks of a given one."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from numpy.random import Generator

from dexgrasp_env.arrays import Array, array
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.objects.parts import support_height
from dexgrasp_env.objects.rest_poses import rest_poses, stays
from dexgrasp_env.poses import quat_conjugate, quat_multiply, rotate, yaw_quat
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.scene.constants import TABLE_CENTRE_X, TABLE_SIZE
from dexgrasp_env.tasks.constants import PLACE_X, PLACE_Y, WORKSPACE_HIGH
from dexgrasp_env.valid import NATURAL, Rule, check, number, pair

PRESENTATIONS = ("rest", "upright")
# m, where an object may be put: ends along x, and to either side
_FRONT, _BACK = (TABLE_CENTRE_X + side * 0.5 * TABLE_SIZE[0] for side in (-1, 1))
_SIDE = 0.5 * TABLE_SIZE[1] + 0.05


def _rest_pose(value: Any) -> str | int:
    return value if value in ("any", "likely", "each") else NATURAL.validate(value)


@dataclass(frozen=True)
class Placement:
    """Ranges that the object's pose is drawn from, in the world frame.

    Attributes:
        x: range of the centre, m, over the table.
        y: range of the centre, m, over the table or just beside it.
        yaw: range of the turn about z, rad.
        rest_pose: `"any"` draws a rest pose by its probability, `"each"` all alike, `"likely"` takes the most probable,
            a number takes that one; objects of the catalogue with a fixed presentation ignore it.
    """

    x: Annotated[tuple[float, float], pair(number(ge=_FRONT, le=_BACK))] = PLACE_X
    y: Annotated[tuple[float, float], pair(number(ge=-_SIDE, le=_SIDE))] = PLACE_Y
    yaw: Annotated[tuple[float, float], pair(number())] = (-np.pi, np.pi)
    rest_pose: Annotated[str | int, Rule("any, each, likely, or a whole number >= 0", _rest_pose)] = "any"

    def sample(self, model: ObjectModel, rng: Generator, presentation: str = "rest") -> Array:
        """Draw a pose (7,): position m and quaternion wxyz.

        Args:
            model: the object.
            rng: four numbers are taken from it.
            presentation: `rest` draws a rest pose; `upright` stands the object as it is built, where it stays so.
        """
        u = rng.random(4)  # always four numbers: one setting does not shift the draws of another
        x, y, yaw = (low + (high - low) * u[i] for i, (low, high) in enumerate((self.x, self.y, self.yaw)))
        upright = upright_rest(model) if presentation == "upright" else None
        quat, height = upright or self._rest(model, u[3])
        height += 0.0005  # m above the table; the settle closes it
        return np.array([x, y, height, *quat_multiply(yaw_quat(yaw), quat)])

    def _rest(self, model: ObjectModel, u: float) -> tuple[Array, float]:
        if model.fixed_pose is not None:
            return fixed_rest(model)
        poses = rest_poses(model)
        if isinstance(self.rest_pose, int):
            if self.rest_pose >= len(poses):
                raise InputError(
                    f"rest_pose {self.rest_pose}: {model.name} has {len(poses)}, valid are 0..{len(poses) - 1}"
                )
            pose = poses[self.rest_pose]
        elif self.rest_pose == "each":
            pose = poses[int(u * len(poses))]
        elif self.rest_pose == "likely":
            pose = max(poses, key=lambda p: p.probability)
        else:
            total = np.cumsum([p.probability for p in poses])
            pose = poses[int(np.searchsorted(total, u * total[-1], side="right").clip(0, len(poses) - 1))]
        return np.asarray(pose.quat_wxyz), float(pose.height)


def fixed_rest(model: ObjectModel) -> tuple[Array, float]:
    """Return quaternion and centre height of the pose that the catalogue presents an object in."""
    quat = np.asarray(model.fixed_pose, dtype=float)
    return quat, float(-rotate(quat, model.solid.vertices)[:, 2].min())


@lru_cache(maxsize=256)  # found by dropping the object
def upright_rest(model: ObjectModel) -> tuple[Array, float] | None:
    """Return quaternion and centre height of the object standing, or None where it does not stay so.

    It stands as it is built, z up, or as its set file says; what the catalogue presents in one pose keeps that.
    """
    if model.fixed_pose is not None:
        return fixed_rest(model)
    quat = np.array([1.0, 0.0, 0.0, 0.0]) if model.upright is None else np.asarray(model.upright)
    up = rotate(quat_conjugate(quat), np.array([0.0, 0.0, 1.0]))
    if not stays(model, up):
        return None
    return quat, support_height(model.parts, up)


def _some_pose(value: Any) -> Array:
    pose: Array = array(7).validate(value)
    if np.linalg.norm(pose[3:]) < 1e-6:
        raise ValueError
    return pose


def check_pose(value: Any, model: ObjectModel, size: float, cell: Cell) -> Array:
    """Return a given pose of the object with its quaternion normalised, (7,).

    Args:
        value: seven numbers, position m in the world frame and quaternion wxyz.
        model: the object; the parts that collide are held against the table, as they are what comes to rest on it.
        size: factor on its lengths.
        cell: whose arm is to reach it.

    Raises:
        InputError: if it is malformed, inside the table, beside it, or out of the arm's reach.
    """
    rule = Rule("7 finite numbers, position in metres and a quaternion wxyz", _some_pose)
    pose = check("object_pose", value, rule)
    x, y, z = pose[:3]
    quat = pose[3:] / np.linalg.norm(pose[3:])
    lowest = z - size * support_height(model.parts, rotate(quat_conjugate(quat), np.array([0.0, 0.0, 1.0])))
    if not (_FRONT <= x <= _BACK and abs(y) <= _SIDE and z <= WORKSPACE_HIGH[2]):
        raise InputError(
            f"object_pose at ({x:g}, {y:g}, {z:g}) m is not over the table: valid are x from {_FRONT:g} to "
            f"{_BACK:g}, |y| up to {_SIDE:g}, z up to {WORKSPACE_HIGH[2]:g}"
        )
    if lowest < -0.001:
        raise InputError(
            f"object_pose reaches {-1000 * lowest:.1f} mm into the table: its z must be {z - lowest:.4f} m or more"
        )
    if np.linalg.norm(pose[:3] - cell.shoulder) > cell.robot.arm.reach:
        raise InputError(
            f"object_pose is out of reach: valid is within {cell.robot.arm.reach} m of the arm's shoulder "
            f"at {cell.shoulder.tolist()}"
        )
    return np.concatenate([pose[:3], quat])
