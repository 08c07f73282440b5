"""Reader of cell files: everything is checked, and what is wrong is said in one line."""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import read_yaml
from dexgrasp_env.robot.cell import SIMULATED, Cell, CellCamera, Joints, Numbers
from dexgrasp_env.robot.home import HOME
from dexgrasp_env.robot.names import MOUNT_NAMES

_SCHEMA = 1
_KEYS = ("schema", "name", "table_height", "mounts", "arm", "hand", "image", "cameras")
_SIZES = {"arm": 7, "hand": 16}
_LIMITS = ("lower", "upper", "velocity", "acceleration", "jerk", "torque")
_EXTRA = {"arm": ("stiffness", "damping"), "hand": ("stiffness",)}
_IMAGE = ("width", "height", "fx", "fy", "cx", "cy")
_FARTHEST = 0.5  # m from link 7 to the palm frame
_TABLE = (-0.15, 0.15)  # m above the base


@lru_cache(maxsize=1)
def simulated_cell() -> Cell:
    """Return the default cell, whose limits are the makers'."""
    return _cell(read_yaml(asset_path("robot", "cell.yaml")))


def read_cell(path: Path) -> Cell:
    """Read a cell file; what it leaves out is as in the simulated cell.

    Raises:
        InputError: one line: what is wrong, where, and what is valid.
    """
    content = read_yaml(path, "cell file")
    if not isinstance(content, dict) or content.get("schema") != _SCHEMA:
        raise InputError(
            f"cell file {path} must be a mapping with schema: {_SCHEMA}, as assets/robot/cell.yaml is"
        )
    default = read_yaml(asset_path("robot", "cell.yaml"))
    try:
        cell = _cell(_merged(default, content))
        if cell.name == SIMULATED and cell != simulated_cell():
            raise InputError(f"a cell needs a `name` of its own: {SIMULATED!r} is the default one's")
        _check_narrower(cell)
        cell.make_cameras()  # checks poses and intrinsics
    except InputError as error:
        raise InputError(f"cell file {path}: {error}") from None
    return cell


def _merged(default: Any, given: Any) -> Any:
    """What is given, with what it leaves out of the default's mappings."""
    if not isinstance(default, dict) or not isinstance(given, dict):
        return given
    return default | {key: _merged(default.get(key), value) for key, value in given.items()}


def _cell(content: Mapping[str, Any]) -> Cell:
    _known("key", content, _KEYS)
    if not isinstance(content["name"], str) or not content["name"]:
        raise InputError(f"name is {content['name']!r}: valid is a word")
    mounts = _mapping("mounts", content["mounts"])
    _known("mount", mounts, MOUNT_NAMES)
    image = _mapping("image", content["image"])
    _known("image setting", image, _IMAGE)
    return Cell(
        name=content["name"], mounts=tuple(_mount(name, mounts[name]) for name in MOUNT_NAMES),
        arm=_joints("arm", content["arm"]), hand=_joints("hand", content["hand"]),
        image=tuple(_numbers(f"image {key}", [image[key]], 1)[0] for key in _IMAGE),
        cameras=_cameras(content["cameras"]), table_height=_table_height(content["table_height"]),
    )  # fmt: skip


def _table_height(value: Any) -> float:
    (height,) = _numbers("table_height", [value], 1)
    if not _TABLE[0] <= height <= _TABLE[1]:
        raise InputError(
            f"table_height is {height}: valid is {_TABLE[0]} to {_TABLE[1]} m above the robot's base"
        )
    return height


def _mount(name: str, value: Any) -> tuple[str, Numbers, Numbers]:
    entry = _mapping(f"mount {name}", value)
    _known(f"setting of mount {name}", entry, ("position", "quat_wxyz"))
    position = _numbers(f"position of mount {name}", entry.get("position"), 3)
    quat = _numbers(f"quat_wxyz of mount {name}", entry.get("quat_wxyz"), 4)
    if abs(float(np.linalg.norm(quat)) - 1.0) > 1e-6:
        raise InputError(f"quat_wxyz of mount {name} has norm {np.linalg.norm(quat):.6f}: valid is 1")
    if float(np.linalg.norm(position)) > _FARTHEST:
        raise InputError(f"position of mount {name} is {position}: valid is within {_FARTHEST} m of link 7")
    return name, position, quat


def _joints(part: str, value: Any) -> Joints:
    entry, size = _mapping(part, value), _SIZES[part]
    names = (*_LIMITS, *_EXTRA[part])
    _known(f"setting of {part}", entry, names)
    given = {name: _numbers(f"{part} {name}", entry[name], size) for name in names}
    for name in names[2:]:
        if min(given[name]) <= 0.0:
            raise InputError(f"{part} {name} has {min(given[name])}: valid are numbers above 0")
    if part == "hand" and len(set(given["stiffness"])) > 1:
        raise InputError("hand stiffness differs between joints: valid is one number")
    return Joints(**given)


def _check_narrower(cell: Cell) -> None:
    """No limit of a cell is wider than the maker's, and home stays inside."""
    for part, home in (("arm", HOME[:7]), ("hand", HOME[7:])):
        own, maker = getattr(cell, part), getattr(simulated_cell(), part)
        for name in _LIMITS:
            sign, word = (-1.0, "least") if name == "lower" else (1.0, "most")
            for joint, value in enumerate(getattr(own, name)):
                bound = getattr(maker, name)[joint]
                if sign * value > sign * bound:
                    raise InputError(
                        f"{part} {name} of joint {joint + 1} is {value}: valid is at {word} {bound}, the maker's"
                    )
        for joint, (low, q, high) in enumerate(zip(own.lower, home, own.upper, strict=True)):
            if not low <= q <= high:
                raise InputError(
                    f"{part} joint {joint + 1} ranges from {low} to {high}: valid ranges hold home, {q:.4f}"
                )


def _cameras(value: Any) -> tuple[CellCamera, ...]:
    if not isinstance(value, list) or not 1 <= len(value) <= 8:
        raise InputError("cameras must be a list of 1 to 8 cameras")
    cameras = tuple(_camera(k + 1, entry) for k, entry in enumerate(value))
    if len({camera.name for camera in cameras}) < len(cameras):
        raise InputError("two cameras have the same name: valid are names of their own")
    return cameras


def _camera(number: int, value: Any) -> CellCamera:
    entry = _mapping(f"camera {number}", value)
    _known(f"setting of camera {number}", entry, ("name", "position", "look_at", "T_base_camera"))
    name = entry.get("name")
    if not isinstance(name, str) or not name:
        raise InputError(f"name of camera {number} is {name!r}: valid is a word")
    if "T_base_camera" in entry:
        rows = entry["T_base_camera"]
        if not isinstance(rows, list) or len(rows) != 4:
            raise InputError(f"T_base_camera of {name} must be 4 rows of 4 numbers")
        pose = [_numbers(f"T_base_camera of {name}", row, 4) for row in rows]
        return CellCamera(name, T_base_camera=tuple(x for row in pose for x in row))
    ends = [_numbers(f"{key} of {name}", entry.get(key), 3) for key in ("position", "look_at")]
    return CellCamera(name, *ends)


def _numbers(what: str, value: Any, size: int) -> Numbers:
    """Check numbers; one stands for all of a hand's."""
    rows = [value] * size if size == 16 and not isinstance(value, list) else value
    if not isinstance(rows, list) or len(rows) != size or not all(map(_is_number, rows)):
        raise InputError(f"{what} is {str(value)[:60]}: valid are {size} finite numbers")
    return tuple(float(x) for x in rows)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _mapping(what: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{what} is {str(value)[:60]}: valid is a mapping of settings")
    return value


def _known(kind: str, given: Mapping[str, Any], valid: tuple[str, ...]) -> None:
    for key in given:
        if key not in valid:
            raise InputError(f"unknown {kind} {key!r}: valid are {', '.join(valid)}")
