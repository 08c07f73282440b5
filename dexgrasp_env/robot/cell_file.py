"""Reader of cell files: everything is checked, and what is wrong is said in one line."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.cell import SIMULATED, Cell, CellCamera, default_cell
from dexgrasp_env.robot.reading import (
    GAINS,
    LIMITS,
    check_narrower,
    mapping,
    number,
    numbers,
    read_joints,
    read_mount,
    word,
)  # fmt: skip
from dexgrasp_env.robot.robot import Joints, Numbers, Robot
from dexgrasp_env.robot.robot_file import find_beside, read_content, read_robot

_KEYS = ("schema", "name", "robot", "table_height", "mounts", "arm", "hand", "image", "cameras")
_IMAGE = ("width", "height", "fx", "fy", "cx", "cy")
_TABLE = (-0.15, 0.15)  # m above the base


def read_cell_or_robot(path: Path) -> Cell | Robot:
    """Read a cell file, or a robot file, which says of itself that it is one.

    Raises:
        InputError: as the reader of either.
    """
    if read_content(path, "cell file").get("kind") == "robot":
        return read_robot(path)
    return read_cell(path)


def read_cell(path: Path) -> Cell:
    """Read a cell file; what it leaves out is as in the simulated cell.

    Raises:
        InputError: one line: what is wrong, where, and what is valid.
    """
    content = read_content(path, "cell file")
    default = read_content(asset_path("robot", "cell.yaml"), "cell file")
    try:
        image = default["image"] | mapping("image", content.get("image", {}), _IMAGE)
        cell = _cell(path.parent, default | content | {"image": image})
        is_default = path.resolve() == asset_path("robot", "cell.yaml").resolve()
        if cell.name == SIMULATED and not is_default and cell != default_cell():
            raise InputError(f"a cell needs a `name` of its own: {SIMULATED!r} is the default one's")
        cell.make_cameras()  # checks poses and intrinsics
    except InputError as error:
        raise InputError(f"cell file {path}: {error}") from None
    return cell


def _cell(folder: Path, content: Mapping[str, Any]) -> Cell:
    for key in content:
        if key not in _KEYS:
            raise InputError(f"unknown key {key!r}: valid are {', '.join(_KEYS)}")
    return Cell(
        name=word("name", content["name"]),
        robot=_narrowed(read_robot(find_beside(folder, content["robot"])), content),
        image=tuple(number(f"image {key}", content["image"][key]) for key in _IMAGE),
        cameras=_cameras(content["cameras"]),
        table_height=_table_height(content["table_height"]),
    )


def _narrowed(robot: Robot, content: Mapping[str, Any]) -> Robot:
    """The robot with the mounts and the narrower limits of a cell."""
    hand, arm = robot.hand, robot.arm
    known = {mount.name: mount for mount in hand.mounts}
    given = mapping("mounts", content.get("mounts", {}), known)
    for name, value in given.items():
        mount = {"position": list(known[name].position), "quat_wxyz": list(known[name].quat_wxyz)}
        known[name] = read_mount(name, mount | mapping(f"mount {name}", value))
    arm = replace(arm, joints=_limits("arm", content, arm.joints, arm.home))
    hand = replace(
        hand, mounts=tuple(known.values()), joints=_limits("hand", content, hand.joints, hand.open)
    )
    return replace(robot, arm=arm, hand=hand, mount=hand.mount(robot.mount.name))


def _limits(part: str, content: Mapping[str, Any], maker: Joints, home: Numbers) -> Joints:
    given = mapping(part, content.get(part, {}), [*LIMITS, *(name for name in GAINS if getattr(maker, name))])
    if not given:
        return maker
    own = {name: list(value) for name, value in asdict(maker).items() if name != "names" and value}
    joints = read_joints(part, own | given, maker.names)
    check_narrower(part, joints, maker, home)
    return joints


def _table_height(value: Any) -> float:
    height = number("table_height", value)
    if not _TABLE[0] <= height <= _TABLE[1]:
        raise InputError(
            f"table_height is {height}: valid is {_TABLE[0]} to {_TABLE[1]} m above the robot's base"
        )
    return height


def _cameras(value: Any) -> tuple[CellCamera, ...]:
    if not isinstance(value, list) or not 1 <= len(value) <= 8:
        raise InputError("cameras must be a list of 1 to 8 cameras")
    cameras = tuple(_camera(k + 1, entry) for k, entry in enumerate(value))
    if len({camera.name for camera in cameras}) < len(cameras):
        raise InputError("two cameras have the same name: valid are names of their own")
    return cameras


def _camera(index: int, value: Any) -> CellCamera:
    entry = mapping(f"camera {index}", value, ("name", "position", "look_at", "T_base_camera"))
    name = word(f"name of camera {index}", entry.get("name"))
    if "T_base_camera" in entry:
        rows = entry["T_base_camera"]
        if not isinstance(rows, list) or len(rows) != 4:
            raise InputError(f"T_base_camera of {name} must be 4 rows of 4 numbers")
        pose = [numbers(f"T_base_camera of {name}", row, 4) for row in rows]
        return CellCamera(name, T_base_camera=tuple(x for row in pose for x in row))
    ends = [numbers(f"{key} of {name}", entry.get(key), 3) for key in ("position", "look_at")]
    return CellCamera(name, *ends)
