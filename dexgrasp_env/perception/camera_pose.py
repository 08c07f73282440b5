"""Poses of cameras in the robot's base as people have them: matrices, ROS's quaternions, files of either."""

import os
import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError, understood
from dexgrasp_env.files import expand, parse_json
from dexgrasp_env.perception.cloud_files import check_scan
from dexgrasp_env.poses import inverse, quat_to_matrix, rigid
from dexgrasp_env.texts import plain_text, without_decimal_commas
from dexgrasp_env.valid import Rule, check
from dexgrasp_env.yaml_file import YAML_SUFFIXES, read_yaml

_WORDS = (
    "a pose of the camera's optical frame in the robot base frame, m: 4 x 4 numbers, or x y z qw qx qy qz"
)
_WITHIN = ("T_base_camera", "matrix", "data", "pose", "transform", "transformation")
"""Keys of mappings that hold a pose, as ROS and calibration tools write them."""
_OFF = 0.01  # of the products of a rotation's rows, and of a quaternion's length: what few digits leave


def pose_of(value: Any) -> Array:
    """Return a pose (4, 4) of whatever states one.

    Args:
        value: 4 x 4 or 3 x 4 numbers, in rows or one after the other; seven, x y z qw qx qy qz; or a mapping as ROS
            writes Pose and Transform (`position` and `orientation`, `translation` and `rotation`), of those seven
            names, or with one of the former under `T_base_camera`, `matrix`, `pose` or `transform`.

    Raises:
        ValueError: for what is no pose; TypeError as well.
    """
    while isinstance(value, Mapping) and (key := next((key for key in _WITHIN if key in value), None)):
        value = value[key]
    if isinstance(value, Mapping):
        try:
            value = _seven(value)
        except KeyError:
            raise ValueError from None
    numbers = np.array(value, dtype=float).ravel()
    if numbers.size == 7:
        length = float(np.linalg.norm(numbers[3:]))
        if not abs(length - 1.0) < _OFF:
            raise InputError(f"the quaternion of the camera's pose has length {length:.3g}: valid is 1")
        T = rigid(quat_to_matrix(numbers[3:] / length), numbers[:3])
    else:
        T = np.vstack([numbers.reshape(-1, 4)[:3], [0.0, 0.0, 0.0, 1.0]])
        if numbers.size not in (12, 16) or not np.allclose(numbers[12:], T[3][: numbers.size - 12]):
            raise ValueError
    R, off = T[:3, :3], np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max()
    if not (off < _OFF and np.linalg.det(R) > 0):
        raise InputError("the rotation of the camera's pose must be orthonormal and right-handed")
    if not (away := np.abs(T[:3, 3]).max()) < 10.0:
        raise InputError(f"the camera's pose is {away:.4g} m away: valid are metres")
    if off > 1e-6:
        from scipy.spatial.transform import Rotation

        T[:3, :3] = Rotation.from_matrix(R).as_matrix()  # the nearest
    return T


def _seven(value: Mapping[str, Any]) -> Any:
    """Return x, y, z, qw, qx, qy, qz of a mapping, or its matrix; a list of four that ROS's names hold ends in w."""
    for place, turn in (("translation", "rotation"), ("position", "orientation")):
        if place in value:
            t, R = (
                [part[axis] for axis in "xyzw" if axis in part] if isinstance(part, Mapping) else part
                for part in (value[place], value[turn])
            )
            return [*t, *R[3:], *R[:3]] if np.ndim(R) == 1 else np.column_stack([R, t])
    return [value[name] for name in ("x", "y", "z", "qw", "qx", "qy", "qz")]


POSE = Rule(_WORDS, pose_of)
"""What states a pose of a camera, see `pose_of`."""


def read_pose(given: str) -> Array:
    """Return a pose (4, 4) that somebody names on the command line.

    Args:
        given: a file (txt, csv, npy, yaml, json) of what `pose_of` takes, or the seven numbers x y z qw qx qy qz;
            `xyzw` behind them says that the quaternion is in ROS's order, qx qy qz qw.

    Raises:
        InputError: one line that says what is wrong with it.
    """
    path, numbers = expand(given), _numbers(given)
    if numbers is not None and not os.path.exists(path):  # sixteen numbers are longer than a name may be
        return check("--camera-pose", numbers, POSE)
    check_scan(path)
    kind = path.suffix.lower()
    if kind in YAML_SUFFIXES:
        return check(str(path), read_yaml(path), POSE)
    with understood(path, f"numbers: valid is {_WORDS}"):
        if kind == ".npy":
            return check(str(path), np.load(path, allow_pickle=False), POSE)
        text = plain_text(path.read_bytes()).decode()
        return check(str(path), parse_json(text) if kind == ".json" else _numbers(text), POSE)


def _numbers(text: str) -> list[float] | None:
    """Return the numbers of a text, apart by blanks, commas and brackets; None for another text."""
    lines = without_decimal_commas([line.partition("#")[0] for line in text.splitlines()])
    words = re.findall(r"[^\s,;\[\]]+", "\n".join(lines))
    order = [word for word in words[-1:] if word in ("wxyz", "xyzw")]
    try:
        found = [float(word) for word in words[: len(words) - len(order)]]
    except ValueError:
        return None
    return [*found[:3], found[6], *found[3:6]] if order == ["xyzw"] and len(found) == 7 else found


def misread_poses(T: Array, given: str) -> Iterator[tuple[str, Array]]:
    """Yield what is often given for a pose (4, 4), in words, and the pose that is meant then."""
    numbers = _numbers(given)
    if numbers is not None and len(numbers) == 7 and not given.strip().endswith(("wxyz", "xyzw")):
        other = pose_of([*numbers[:3], numbers[6], *numbers[3:6]])
        yield "had the quaternion as ROS does, qx qy qz qw: then say so by `xyzw` behind it", other
    yield "were inverted: valid is the camera in the base, not the base in the camera", inverse(T)
    optical = T.copy()
    optical[:3, :3] = T[:3, :3] @ [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    yield "were of a camera's body, x forward: valid is its optical frame, z forward", optical
