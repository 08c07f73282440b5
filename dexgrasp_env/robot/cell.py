"""The cell as a value: a robot, its base, the table and the cameras; environment, planner and exporter are given one.

Files are in the frame of the robot's base; everything inside is in the world's, whose origin is on the table's top,
straight above or below the base, with the same axes: `Cell.base` is all that lies between them. Where a table was seen
(`Cell.seeing`), the world is where that is.
"""

import os
from collections.abc import Mapping
from dataclasses import astuple, dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from dexgrasp_env.arrays import Array, Fields
from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.files import content_hash, expand
from dexgrasp_env.poses import inverse, placed, shifted
from dexgrasp_env.robot.camera import Camera, CameraIntrinsics
from dexgrasp_env.robot.robot import Hand, Mount, Numbers, Robot, Vector
from dexgrasp_env.robot.robot_file import find_beside, narrowed, read_content, read_robot, said_of
from dexgrasp_env.robot.table import SeenTable
from dexgrasp_env.valid import NAMED, Names, Rule, Word, check, number, read, several


def _rows(value: Any) -> Numbers:
    return sum(several(several(number(), 4), 4).validate(value), ())


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
    mounts: dict[str, Fields] = field(default_factory=dict)
    arm: Fields = field(default_factory=dict)
    hand: Fields = field(default_factory=dict)


def _mounts(hand: Hand, given: Mapping[str, Mapping[str, Any]]) -> tuple[Mount, ...]:
    """Return the mounts of a hand, with what a cell states of them."""
    known = {mount.name: mount for mount in hand.mounts}
    for name, change in given.items():
        if name not in known:
            raise unknown_name("setting of mounts", name, known)
        if not isinstance(change, Mapping) or "name" in change:
            raise InputError(f"mount {name} is {change!r}: valid are settings of a mount, but for its name")
        known[name] = read(Mount, {**vars(known[name]), **change}, f"mount {name}")
    return tuple(known.values())


SIMULATED = "simulated"
"""Name of the default cell, which no other may bear."""


@dataclass(frozen=True)
class Cell:
    """A robot at a table, watched by cameras; metres, radians, frame of the robot's base.

    Attributes:
        name: of the cell.
        robot: with the mount in use.
        image: width, height, fx, fy, cx, cy of every camera, pixels.
        cameras: of the environment.
        table_height: of the table's top, m.
        table: the table where it was seen; None where it is as the cell has it.
    """

    name: str
    robot: Robot
    image: Numbers
    cameras: tuple[CellCamera, ...]
    table_height: float
    table: SeenTable | None = field(default=None, repr=False)

    def __hash__(self) -> int:
        """Cells are keys of caches: hashing all that a robot is takes long."""
        return hash(self.version)

    @cached_property
    def version(self) -> str:
        """Version of the cell, for evaluations, datasets and demonstrations: its name, and a hash of all its values."""
        return f"{self.name}-{content_hash(repr(self), self.robot.hash)[:8]}"

    @property
    def stamp(self) -> str:
        """Name of the cell in grasp files: its version, of the default its name alone."""
        return self.name if self.name == SIMULATED else self.version

    @cached_property
    def T_world_base(self) -> Array:  # noqa: N802
        """Pose of the robot's base in the world, (4, 4) m; turned only where a table was seen to lean."""
        if self.table is not None:
            return self.table.T_world_base(self.table_height)
        return shifted(np.eye(4), np.array([0.0, 0.0, 0.0 - self.table_height]))

    @cached_property
    def T_base_world(self) -> Array:  # noqa: N802
        """Pose of the world in the frame of the robot's base, (4, 4) m."""
        return inverse(self.T_world_base)

    @property
    def base(self) -> Array:
        """Position of the robot's base in the world, (3,) m."""
        return self.T_world_base[:3, 3].copy()

    @property
    def shoulder(self) -> Array:
        """Origin of the arm's reach in the world, (3,) m."""
        return placed(self.T_world_base, np.array(self.robot.arm.shoulder))

    def seeing(self, table: SeenTable | None) -> "Cell":
        """Return the cell with its table where it was seen; None: where the cell has it."""
        if table is self.table:
            return self
        there = replace(self, table=table)
        vars(there)["version"] = self.version  # which says nothing of the table
        return there

    @property
    def mounts(self) -> Names:
        """Names of the mounts that its hand knows."""
        return tuple(mount.name for mount in self.robot.hand.mounts)

    def mounted(self, mount: str | None) -> "Cell":
        """Return the cell with its hand mounted otherwise; None changes nothing.

        Raises:
            InputError: for an unknown mount.
        """
        if mount is None or mount == self.robot.mount.name:
            return self
        return replace(self, robot=replace(self.robot, mount=self.robot.hand.mount(mount)))

    def grasping(self, fingers: Names) -> "Cell":
        """Return the cell whose hand grasps with fingers of its `grasps`; others change nothing."""
        hand = self.robot.hand
        if fingers == hand.grasp or fingers not in hand.grasps:
            return self
        return replace(self, robot=replace(self.robot, hand=replace(hand, grasp=fingers)))

    @property
    def camera_names(self) -> Names:
        """Names of the cameras."""
        return tuple(camera.name for camera in self.cameras)

    def make_cameras(self, intrinsics: CameraIntrinsics | None = None) -> tuple[Camera, ...]:
        """Return the cameras in the world, with the cell's intrinsics or others."""
        width, height, *lens = self.image
        lens_of_all = intrinsics or CameraIntrinsics(int(width), int(height), *lens)
        return tuple(self._camera(camera, lens_of_all) for camera in self.cameras)

    def _camera(self, camera: CellCamera, lens: CameraIntrinsics) -> Camera:
        if not camera.T_base_camera:
            ends = np.array([camera.position, camera.look_at])
            position, target = placed(self.T_world_base, ends)
            return Camera.look_at(camera.name, position, target, lens)
        T_base_camera = np.reshape(camera.T_base_camera, (4, 4))
        return Camera(camera.name, self.T_world_base @ T_base_camera, lens)


Given = Cell | Robot | str | os.PathLike[str] | None
"""What `robot=` may be: a cell, a robot, the path of a file of either, the name of a robot of ours, or None for the
simulated cell."""


@lru_cache(maxsize=1)
def default_cell() -> Cell:
    """Return the simulated cell, whose limits are the makers'."""
    return read_cell(asset_path("robot", "cell.yaml"))


def read_cell(path: Path) -> Cell:
    """Read a cell file; what it leaves out is as in the simulated cell.

    Raises:
        InputError: one line: what is wrong, where, and what is valid.
    """
    ours = asset_path("robot", "cell.yaml")
    content = read_content(path, "cell file")
    with said_of(path):
        file = read(_CellFile, read_content(ours, "cell file") | content)
        robot = read_robot(find_beside(path.parent, file.robot))
        arm = replace(robot.arm, joints=narrowed("arm", file.arm, robot.arm.joints, robot.arm.home))
        hand = replace(
            robot.hand, mounts=_mounts(robot.hand, file.mounts),
            joints=narrowed("hand", file.hand, robot.hand.joints, robot.hand.open),
        )  # fmt: skip
        robot = replace(robot, arm=arm, hand=hand, mount=hand.mount(robot.mount.name))
        cell = Cell(file.name, robot, tuple(map(float, astuple(file.image))), file.cameras, file.table_height)
        if cell.name == SIMULATED and path.resolve() != ours.resolve() and cell != default_cell():
            raise InputError(f"a cell needs a `name` of its own: {SIMULATED!r} is the default one's")
        cell.make_cameras()  # checks poses
    return cell


def make_cell(robot: Given = None, mount: str | None = None) -> Cell:
    """Return the cell that is meant.

    Args:
        robot: see `Given`; a robot alone stands in the simulated cell.
        mount: of the hand, None for the robot's own.

    Raises:
        InputError: for a file that is neither a cell nor a robot, an unknown name, or an unknown mount.
    """
    if not isinstance(robot, Cell | Robot | None):
        name = str(check("robot", robot, NAMED))
        path = robot_files().get(name) or expand(name)
        if not path.suffix and not path.exists():
            raise unknown_name("robot", name, [*robot_files(), "the path of a robot's or a cell's file"])
        robot = _read(path.resolve(), path.stat().st_mtime_ns) if path.is_file() else read_cell(path)
    if isinstance(robot, Robot):
        robot = replace(default_cell(), name=robot.name, robot=robot)
    return (robot or default_cell()).mounted(mount)


def whole_path(robot: Any) -> str:
    """Return a robot's name as it is, or the path of a file so that it is found from any folder, by any worker."""
    name = str(NAMED.validate(robot))
    path = expand(name)
    return str(path.resolve()) if name not in robot_files() and path.exists() else name


@lru_cache(maxsize=1)
def robot_files() -> dict[str, Path]:
    """Return the robot files of ours, by the robot's name."""
    files = asset_path("robot").glob("*.yaml")
    return {f.stem: f for f in sorted(files) if read_content(f, "robot file").get("kind") == "robot"}


@lru_cache(maxsize=16)
def _read(path: Path, stamp: int) -> Cell | Robot:
    """Read a cell file, or a robot file, which says of itself that it is one, once for each state of it (`stamp`)."""
    is_robot = read_content(path, "cell file").get("kind") == "robot"
    return read_robot(path) if is_robot else read_cell(path)
