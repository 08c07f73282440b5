"""Settings of the environment, checked once at construction."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.objects.load import load_object, resolve_targets
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.robot.mounts import MOUNTS
from dexgrasp_env.scene.constants import FRICTION
from dexgrasp_env.tasks.control import CONTROL_MODES
from dexgrasp_env.tasks.observations import OBS_MODES
from dexgrasp_env.tasks.placement import Placement
from dexgrasp_env.tasks.randomisation import Randomisation
from dexgrasp_env.tasks.rewards import REWARD_MODES

OBSERVE = ("step", "reset")
RENDER_MODES = ("human", "rgb_array", "depth_array")


@dataclass(frozen=True)
class LiftSettings:
    """Everything that `gym.make` accepts, in checked form; see `LiftEnv` for the meanings."""

    objects: tuple[str, ...]
    obs_mode: str = "state"
    control_mode: str = "joint_delta"
    reward_mode: str = "dense"
    mount: str = "palm_normal"
    friction: float = FRICTION
    object_pose: Placement = Placement()
    randomisation: Randomisation = Randomisation()
    observe: str = "step"
    mesh_scale: float = 1.0
    mesh_mass: float | None = None
    render_mode: str | None = None

    @classmethod
    def of(
        cls,
        objects: str | Sequence[str],
        object_pose: Placement | Mapping[str, Any] | None,
        randomisation: Randomisation | Mapping[str, Any] | None,
        **names: Any,
    ) -> "LiftSettings":
        """Check the arguments of the environment.

        Raises:
            InputError: one line that says which is wrong and what is valid.
        """
        for key, valid in _CHOICES.items():
            if names[key] not in valid:
                raise unknown_name(key, names[key], valid)
        friction = names["friction"]
        if not (isinstance(friction, int | float) and np.isfinite(friction) and 0.0 < friction <= 2.0):
            raise InputError(f"friction = {friction!r}: valid is a number above 0 and up to 2")
        targets = resolve_targets([objects] if isinstance(objects, str) else list(objects))
        return cls(
            objects=tuple(targets), object_pose=Placement.of(object_pose),
            randomisation=Randomisation.of(randomisation), **names,
        )  # fmt: skip

    def load_objects(self) -> dict[str, ObjectModel]:
        """Load the objects; `mesh_scale` and `mesh_mass` apply to meshes of the user's alone."""
        return {target: load_target(target, self.mesh_scale, self.mesh_mass) for target in self.objects}


_CHOICES = {
    "obs_mode": OBS_MODES,
    "control_mode": CONTROL_MODES,
    "reward_mode": REWARD_MODES,
    "mount": tuple(MOUNTS),
    "observe": OBSERVE,
    "render_mode": (None, *RENDER_MODES),
}


def load_target(target: str, mesh_scale: float = 1.0, mesh_mass: float | None = None) -> ObjectModel:
    """Load a name of the catalogue, or a mesh file with its scale and mass."""
    from dexgrasp_env.objects.catalogue import CATALOGUE

    if target in CATALOGUE:
        return load_object(target)
    return load_object(target, scale=mesh_scale, mass=mesh_mass)
