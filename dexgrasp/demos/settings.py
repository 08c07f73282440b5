"""What a set of demonstrations is made of."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from dexgrasp.runs.versions import package_versions
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.robot.cell import make_cell

SCHEMA = 1
ENV_ID = "DexGrasp/Lift-v2"
CAMERA_KEYS = ("cloud", "cloud_normals", "cloud_mask", "table_plane", "depth", "rgb")
"""Observations of cameras; with `observe="reset"` they are the same all episode long and are stored once."""
_PACKAGES = ("dexgrasp", "mujoco", "numpy", "gymnasium")


@dataclass(frozen=True)
class DemoSettings:
    """Everything that demonstrations depend on.

    Attributes:
        objects: names of the catalogue, `varied-N`, paths of meshes or members of set files.
        agent: who demonstrates; it sees and acts in its own modes.
        episodes: scenes tried of each object; those that end in success, twice, are kept.
        seed: of scenes, agent and noise.
        obs_mode: of the demonstrations.
        control_mode: of the demonstrations: what is commanded is converted.
        observe: `step` or `reset`, of the demonstrations.
        noise: standard deviation added to what the agent commands, as a share of the velocity limits; the agent, which
            sees what comes of it, corrects it, and whoever learns from it learns to.
        friction: sliding coefficient; None for the default.
        robot: path of a cell's or a robot's file; None for the simulated cell.
        mount: how the hand sits on the flange; None for the robot's own.
        chunk: scenes a file while it is made.
    """

    objects: tuple[str, ...]
    agent: str = "bilevel"
    episodes: int = 10
    seed: int = 0
    obs_mode: str = "state"
    control_mode: str = "joint_delta"
    observe: str = "reset"
    noise: float = 0.0
    friction: float | None = None
    robot: str | None = None
    mount: str | None = None
    chunk: int = 25

    @classmethod
    def of(cls, objects: Sequence[str], **rest: Any) -> "DemoSettings":
        """Expand sets of objects and check what can be checked without building anything.

        Raises:
            InputError: for an unknown object, agent or mode, or a number out of range.
        """
        from dexgrasp.registry import check_name
        from dexgrasp_env.objects.load import resolve_targets
        from dexgrasp_env.tasks.control import CONTROL_MODES
        from dexgrasp_env.tasks.observations import OBS_MODES
        from dexgrasp_env.tasks.settings import OBSERVE

        settings = cls(tuple(resolve_targets(list(objects))), **rest)
        check_name(settings.agent)
        make_cell(settings.robot, settings.mount)
        valid = {
            "obs_mode": OBS_MODES,
            "control_mode": CONTROL_MODES,
            "observe": OBSERVE,
        }
        for key, names in valid.items():
            if getattr(settings, key) not in names:
                raise unknown_name(key, getattr(settings, key), names)
        if settings.episodes < 1 or settings.chunk < 1 or settings.seed < 0:
            raise InputError("valid are episodes and chunk from 1 on, and a seed from 0 on")
        if not 0.0 <= settings.noise <= 1.0:
            raise InputError(f"noise is {settings.noise}: valid are shares from 0 to 1")
        return settings

    @property
    def env_arguments(self) -> dict[str, Any]:
        """What `gym.make` is called with for the demonstrations, objects apart."""
        looks = {} if self.obs_mode == "state" else {"observe": self.observe}
        return {
            "obs_mode": self.obs_mode,
            "control_mode": self.control_mode,
            "robot": self.robot,
            "mount": self.mount,
            "friction": self.friction,
            **looks,
        }

    def as_json(self) -> dict[str, Any]:
        """Return the settings as JSON holds them, with the cell and the versions that they rest on."""
        rest = {"cell": make_cell(self.robot).version, "versions": package_versions(_PACKAGES)}
        return asdict(self) | {"objects": list(self.objects)} | rest

    @classmethod
    def of_json(cls, saved: Mapping[str, Any], robot: str | None = None) -> "DemoSettings":
        """Return the settings that `as_json` wrote, in the cell of a file where they name none that is here.

        Raises:
            InputError: if they are of another cell, or none.
        """
        given = {key: value for key, value in saved.items() if key not in ("cell", "versions")}
        given["robot"] = robot or given.get("robot")
        here = make_cell(given["robot"]).version
        cell = saved.get("cell", here)  # before 0.2.0 none was stated
        if cell != here:
            raise InputError(f"demonstrations of cell {cell!r}: this is {here!r}, give their --cell")
        try:
            return cls(**given | {"objects": tuple(given["objects"])})
        except (TypeError, KeyError):
            raise InputError("the settings of the demonstrations are damaged: make them anew") from None
