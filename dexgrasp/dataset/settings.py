"""Settings of the grasp dataset, and what a folder of it was made from."""

import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.runs.versions import package_versions
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.cell import Cell, make_cell

SCHEMA = 1
_PACKAGES = ("numpy", "scipy", "numba", "daqp", "trimesh", "mujoco")
MU = 0.4
"""Friction coefficient of Eq. 4 in the dataset (the original's, as far as we know)."""
POINTS = 256
"""Candidate contact points a rest pose (section 1.3, step 2)."""


def dataset_planner() -> PlannerSettings:
    """Return the planner's thresholds with the dataset's friction and number of points."""
    return replace(PlannerSettings(), friction=MU, surface_points=POINTS)


@dataclass(frozen=True)
class DatasetSettings:
    """What a dataset is made of.

    Attributes:
        objects: names of the catalogue or paths of meshes.
        grasps_per_pose: grasps asked for of each rest pose; a pose that has fewer gives what it has.
        seed: of everything.
        chunk: grasps a shard.
        tries: hand postures tried for a grasp asked for, before a shard gives up.
        least_load: of the weight, what a posture is estimated to bear before it is tried; few below come to bear it.
        mesh_scale: factor to metres, of meshes alone.
        mesh_mass: kg, of meshes alone.
        robot: path of a cell's or a robot's file; None for the simulated cell.
        planner: thresholds of the kinematic check.
    """

    objects: tuple[str, ...]
    grasps_per_pose: int = 200
    seed: int = 0
    chunk: int = 200
    tries: int = 12
    least_load: float = 0.8
    mesh_scale: float = 1.0
    mesh_mass: float | None = None
    robot: str | None = None
    planner: PlannerSettings = field(default_factory=dataset_planner)

    @classmethod
    def of(cls, objects: Sequence[str], **rest: Any) -> "DatasetSettings":
        """Expand sets of objects and check the numbers.

        Raises:
            InputError: for an unknown object or a number out of range.
        """
        from dexgrasp_env.objects.load import resolve_targets

        settings = cls(tuple(resolve_targets(list(objects))), **rest)
        for name in ("grasps_per_pose", "chunk", "tries"):
            if getattr(settings, name) < 1:
                raise InputError(f"{name} is {getattr(settings, name)}: valid are whole numbers from 1 on")
        if settings.seed < 0:
            raise InputError(f"seed is {settings.seed}: valid are whole numbers from 0 on")
        return settings

    @property
    def cell(self) -> Cell:
        """The cell that `robot` means."""
        return make_cell(self.robot)

    @property
    def chunks(self) -> int:
        """Shards a rest pose."""
        return -(-self.grasps_per_pose // self.chunk)

    def quota(self, chunk: int) -> int:
        """Grasps asked for of a shard."""
        return min(self.chunk, self.grasps_per_pose - chunk * self.chunk)

    def as_json(self) -> dict[str, Any]:
        """Return the settings as JSON holds them; meshes by their file name (their content is hashed apart)."""
        from dexgrasp_env.objects.load import object_name

        return asdict(self) | {"objects": [object_name(name) for name in self.objects]}


def versions() -> dict[str, str]:
    """Return the versions that bits may depend on."""
    return {"python": platform.python_version()} | package_versions(_PACKAGES)
