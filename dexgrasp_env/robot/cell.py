"""The cell as data: table, mounts, limits, gains, torques, cameras; planner, environment and exporter read one file.

Files are in the frame of the robot's base; everything inside is in the world's, whose origin is on the table's top,
straight above or below the base, with the same axes: `Cell.base` is all that lies between them.

A process has one cell, so that nothing planned in one is carried out in another: the simulated one of
`assets/robot/cell.yaml`, or that of `use_cell` (`--cell FILE`, DEXGRASP_CELL).
"""

import os
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import content_hash, expand
from dexgrasp_env.robot.camera import Camera, CameraIntrinsics

VARIABLE = "DEXGRASP_CELL"
SIMULATED = "simulated"
"""Name of the default cell, which no other may bear."""
Numbers = tuple[float, ...]


@dataclass(frozen=True)
class Joints:
    """Limits and gains of the arm's 7 or of the hand's 16 joints: rad, s, Nm; gains Nm/rad and Nm s/rad."""

    lower: Numbers
    upper: Numbers
    velocity: Numbers
    acceleration: Numbers
    jerk: Numbers
    torque: Numbers
    stiffness: Numbers
    damping: Numbers = ()  # of the arm's servos; the hand's are critically damped


@dataclass(frozen=True)
class CellCamera:
    """A camera's place: where it stands and looks at (3,) m, or its pose, 16 numbers row by row."""

    name: str
    position: Numbers = ()
    look_at: Numbers = ()
    T_base_camera: Numbers = ()


@dataclass(frozen=True)
class Cell:
    """What a cell file says; metres, radians, frame of the robot's base.

    Attributes:
        name: of the cell.
        mounts: position (3,) and quaternion wxyz (4,) of the palm frame in that of link 7, by name.
        arm, hand: limits and gains.
        image: width, height, fx, fy, cx, cy of every camera, pixels.
        cameras: of the environment.
        table_height: of the table's top, m.
    """

    name: str
    mounts: tuple[tuple[str, Numbers, Numbers], ...]
    arm: Joints
    hand: Joints
    image: Numbers
    cameras: tuple[CellCamera, ...]
    table_height: float = field(default=0.0, repr=False)

    @cached_property
    def version(self) -> str:
        """What evaluations, datasets and demonstrations call it: its name, and a hash of all that it says."""
        table = [self.table_height] if self.table_height else []  # hashes of before 0.2.0 had none
        return f"{self.name}-{content_hash(repr(self), *table)[:8]}"

    @property
    def stamp(self) -> str:
        """What grasp files call it: its version, of the default its name alone."""
        return self.name if self.is_simulated else self.version

    @property
    def base(self) -> Array:
        """Where the robot's base stands in the world, (3,) m."""
        return np.array([0.0, 0.0, 0.0 - self.table_height])

    def make_cameras(self, intrinsics: CameraIntrinsics | None = None) -> tuple[Camera, ...]:
        """Return the cameras in the world, with the cell's intrinsics or others."""
        width, height, *lens = self.image
        lens_of_all = intrinsics or CameraIntrinsics(int(width), int(height), *lens)
        return tuple(self._camera(camera, lens_of_all) for camera in self.cameras)

    def _camera(self, camera: CellCamera, lens: CameraIntrinsics) -> Camera:
        if not camera.T_base_camera:
            position, target = (np.array(end) + self.base for end in (camera.position, camera.look_at))
            return Camera.look_at(camera.name, position, target, lens)
        T_world_camera = np.reshape(camera.T_base_camera, (4, 4)).copy()
        T_world_camera[:3, 3] += self.base
        return Camera(camera.name, T_world_camera, lens)

    @property
    def is_simulated(self) -> bool:
        """Whether it is the default cell."""
        return self.name == SIMULATED


@lru_cache(maxsize=1)
def active_cell() -> Cell:
    """Return the cell of this process; from the first call on it stays.

    Raises:
        InputError: if the file that DEXGRASP_CELL names is no cell.
    """
    from dexgrasp_env.robot.cell_file import read_cell, simulated_cell

    named = os.environ.get(VARIABLE)
    return read_cell(Path(named)) if named else simulated_cell()


def use_cell(path: str | os.PathLike[str]) -> Cell:
    """Choose the cell of this process and of those that it starts, before anything else is imported or made.

    Raises:
        InputError: for a file that is no cell, or where another cell is in use already.
    """
    from dexgrasp_env.robot.cell_file import read_cell

    cell = read_cell(expand(path))
    if active_cell.cache_info().currsize and active_cell() != cell:
        raise InputError(
            f"cell {active_cell().name!r} is in use in this process: choose before anything is made, or set {VARIABLE}"
        )
    os.environ[VARIABLE] = str(expand(path).resolve())
    return active_cell()
