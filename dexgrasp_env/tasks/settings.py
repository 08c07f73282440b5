"""Settings of the environment, checked once at construction."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.objects.load import load_target, resolve_targets
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.rendering import SHOW_CAMERAS
from dexgrasp_env.robot.active import active_cell
from dexgrasp_env.robot.cell import Cell, default_cell, make_cell
from dexgrasp_env.scene.constants import FRICTION
from dexgrasp_env.sensing.calibration import Calibration
from dexgrasp_env.tasks.control import CONTROL_MODES
from dexgrasp_env.tasks.disturbance import Disturbance
from dexgrasp_env.tasks.observations import OBS_MODES
from dexgrasp_env.tasks.placement import PRESENTATIONS, Placement
from dexgrasp_env.tasks.randomisation import Randomisation
from dexgrasp_env.tasks.rewards import REWARD_MODES

DEFAULT_VIEWS = 4
OBSERVE = ("step", "reset", "clear")
RENDER_MODES = ("human", "rgb_array", "depth_array")


@dataclass(frozen=True)
class LiftSettings:
    """Everything that `gym.make` accepts, in checked form; see `LiftEnv` for the meanings."""

    objects: tuple[str, ...]
    obs_mode: str = "state"
    control_mode: str = "joint_delta"
    reward_mode: str = "dense"
    cell: Cell = field(default_factory=default_cell)
    friction: float | None = None
    mass: float = 1.0
    presentation: str = "rest"
    disturbance: Disturbance = Disturbance()
    object_pose: Placement = Placement()
    randomisation: Randomisation = Randomisation()
    views: tuple[str, ...] | int = DEFAULT_VIEWS
    calibration: Calibration = Calibration()
    observe: str = "step"
    mesh_scale: float = 1.0
    mesh_mass: float | None = None
    render_mode: str | None = None
    render_camera: str = "front"

    @classmethod
    def of(cls, objects: str | Sequence[str], **given: Any) -> "LiftSettings":
        """Check the arguments of the environment.

        Raises:
            InputError: one line that says which is wrong and what is valid.
        """
        robot = given.pop("robot")
        cell = make_cell(active_cell() if robot is None else robot, given.pop("mount"))
        choices = _CHOICES | {"render_camera": (*SHOW_CAMERAS, *cell.camera_names)}
        for key, valid in choices.items():
            if given[key] not in valid:
                raise unknown_name(key, given[key], valid)
        if given["friction"] is not None:
            _check_number("friction", given["friction"], 2.0)
        _check_number("mass", given["mass"], 100.0)
        parts = {
            "object_pose": Placement.of(given["object_pose"]),
            "randomisation": Randomisation.of(given["randomisation"]),
            "disturbance": Disturbance.of(given["disturbance"]),
            "calibration": Calibration.of(given["calibration"]),
            "views": _check_views(given["views"], cell.camera_names),
            "cell": cell,
        }
        targets = resolve_targets(_check_names(objects))
        return cls(objects=tuple(targets), **(given | parts))

    @property
    def mount(self) -> str:
        """How the hand sits on the flange."""
        return self.cell.robot.mount.name

    def friction_of(self, model: ObjectModel) -> float:
        """Return the sliding coefficient given, else the object's own, else the default."""
        given = (self.friction, model.friction, FRICTION)
        return next(float(value) for value in given if value is not None)

    def load_objects(self) -> dict[str, ObjectModel]:
        """Load the objects; `mesh_scale` and `mesh_mass` apply to meshes of the user's alone."""
        return {target: load_target(target, self.mesh_scale, self.mesh_mass) for target in self.objects}


_CHOICES = {
    "obs_mode": OBS_MODES,
    "control_mode": CONTROL_MODES,
    "reward_mode": REWARD_MODES,
    "presentation": PRESENTATIONS,
    "observe": OBSERVE,
    "render_mode": (None, *RENDER_MODES),
}


def _check_names(objects: Any) -> list[str]:
    single = isinstance(objects, str) or not isinstance(objects, Iterable)
    names = [objects] if single else list(objects)
    if not all(isinstance(name, str) for name in names):
        raise InputError(f"objects = {objects!r}: valid is a name or a list of names")
    return names


def _check_number(name: str, value: Any, most: float) -> None:
    if not (isinstance(value, int | float) and np.isfinite(value) and 0.0 < value <= most):
        raise InputError(f"{name} = {value!r}: valid is a number above 0 and up to {most:g}")


def _check_views(value: Any, cameras: tuple[str, ...]) -> tuple[str, ...] | int:
    """Names of cameras, or how many of them to draw at each reset."""
    if isinstance(value, int) and not isinstance(value, bool):
        most = max(len(cameras), DEFAULT_VIEWS)  # a cell with fewer cameras has all of them look
        if not 1 <= value <= most:
            raise InputError(f"views = {value}: valid are 1 to {most} cameras, or their names")
        return min(value, len(cameras))
    names = (value,) if isinstance(value, str) else tuple(value)
    for name in names:
        if name not in cameras:
            raise unknown_name("view", name, cameras)
    if not names or len(set(names)) < len(names):
        raise InputError(f"views = {value!r}: valid are one or more of {', '.join(cameras)}, each once")
    return names
