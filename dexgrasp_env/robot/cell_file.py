"""Reader of cell files: everything is checked, and what is wrong is said in one line."""

from collections.abc import Mapping
from dataclasses import astuple, dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Annotated, Any

from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.robot.camera import CameraIntrinsics
from dexgrasp_env.robot.limits import narrowed
from dexgrasp_env.robot.robot import Hand, Mount, Numbers, Vector
from dexgrasp_env.robot.robot_file import find_beside, read_content, read_robot, said_of
from dexgrasp_env.valid import Rule, Word, number, read, several


def _rows(value: Any) -> Numbers:
    return tuple(chain.from_iterable(several(several(number(), 4), 4).admit(value)))


@dataclass(frozen=True)
class CellCamera:
    """A camera's place: where it stands and looks at (3,) m, or its pose, 16 numbers row by row."""

    name: Word
    position: Vector = ()
    look_at: Vector = ()
    T_base_camera: Annotated[Numbers, Rule("4 rows of 4 numbers", _rows)] = ()


def _cameras(value: Any) -> tuple[CellCamera, ...]:
    cameras = tuple(read(CellCamera, entry, f"camera {k + 1}") for k, entry in enumerate(value))
    if not 1 <= len(cameras) <= 8:
        raise ValueError
    for camera in cameras:
        if not camera.T_base_camera and not (camera.position and camera.look_at):
            raise InputError(
                f"position or look_at of {camera.name} is missing: valid are both, or T_base_camera"
            )
    if len({camera.name for camera in cameras}) < len(cameras):
        raise InputError("two cameras have the same name: valid are names of their own")
    return cameras


@dataclass(frozen=True)
class _CellFile:
    """A cell as its file states it; see `assets/robot/cell.yaml`."""

    schema: int
    name: Word
    robot: Word
    table_height: Annotated[float, number(ge=-0.15, le=0.15)]  # m above the robot's base
    image: CameraIntrinsics
    cameras: Annotated[tuple[CellCamera, ...], Rule("a list of 1 to 8 cameras", _cameras)]
    mounts: dict[str, dict[str, Any]] = field(default_factory=dict)
    arm: dict[str, Any] = field(default_factory=dict)
    hand: dict[str, Any] = field(default_factory=dict)


def read_cell_fields(path: Path) -> dict[str, Any]:
    """Read the fields of a `Cell` from its file; what that leaves out is as in the simulated cell.

    Raises:
        InputError: one line: what is wrong, where, and what is valid.
    """
    content = read_content(path, "cell file")
    default = read_content(asset_path("robot", "cell.yaml"), "cell file")
    with said_of(path):
        file = read(_CellFile, default | content)
        robot = read_robot(find_beside(path.parent, file.robot))
        arm = replace(robot.arm, joints=narrowed("arm", file.arm, robot.arm.joints, robot.arm.home))
        hand = replace(
            robot.hand, mounts=_mounts(robot.hand, file.mounts),
            joints=narrowed("hand", file.hand, robot.hand.joints, robot.hand.open),
        )  # fmt: skip
        return {
            "name": file.name,
            "robot": replace(robot, arm=arm, hand=hand, mount=hand.mount(robot.mount.name)),
            "image": tuple(map(float, astuple(file.image))),
            "cameras": file.cameras,
            "table_height": file.table_height,
        }


def _mounts(hand: Hand, given: Mapping[str, Mapping[str, Any]]) -> tuple[Mount, ...]:
    """Return the mounts of a hand, with what a cell states of them."""
    known = {mount.name: mount for mount in hand.mounts}
    for name, change in given.items():
        if name not in known:
            raise unknown_name("setting of mounts", name, known)
        known[name] = read(Mount, {**vars(known[name]), **change}, f"mount {name}")
    return tuple(known.values())
