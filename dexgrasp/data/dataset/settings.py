"""Settings of the grasp dataset."""

import platform
from dataclasses import asdict, dataclass, field
from typing import Annotated

from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.runs.versions import package_versions
from dexgrasp_env.arrays import Fields
from dexgrasp_env.objects.load import Objects, OfObjects, object_name
from dexgrasp_env.robot.cell import Cell, make_cell, whole_path
from dexgrasp_env.valid import CellFile, Count, Mass, Natural, Positive, Rule

SCHEMA = 1
MU = 0.4
"""Friction coefficient of Eq. 4 in the dataset: the original's, as far as we know."""


@dataclass(frozen=True)
class DatasetSettings(OfObjects):
    """Settings of a dataset.

    Attributes:
        objects: objects, sets or mesh files.
        grasps_per_pose: asked for of each rest pose; a pose that has fewer gives what it has.
        seed: of everything.
        chunk: grasps a file.
        tries: postures tried for a grasp asked for, before a file gives up.
        least_load: of the weight, what a posture is estimated to bear before it is tried; few below come to bear it.
        mesh_scale: factor from a mesh file's unit to metres, 0.001 for millimetres.
        mesh_mass: mass of a mesh, kg (default: by its volume).
        robot: file of your cell (robot, table, mounts, limits, gains, torques and cameras), or of a robot alone
            (default: the simulated cell; on the command line $DEXGRASP_CELL, where it is set).
        planner: thresholds of the kinematic check.
    """

    objects: Annotated[Objects, "OBJECT"]
    grasps_per_pose: Count = 200
    seed: Natural = 0
    chunk: Count = 200
    tries: Count = 12
    least_load: float = 0.8
    mesh_scale: Annotated[Positive, "F"] = 1.0
    mesh_mass: Annotated[Mass | None, "KG"] = None
    robot: Annotated[CellFile, Rule("the path of a file, or a robot's name", whole_path)] = None
    # 256 candidate contact points a rest pose (section 1.3, step 2).
    planner: PlannerSettings = field(default_factory=lambda: PlannerSettings(friction=MU, surface_points=256))

    @property
    def cell(self) -> Cell:
        """Cell that `robot` names."""
        return make_cell(self.robot)

    @property
    def chunks(self) -> int:
        """Number of shards of a rest pose."""
        return -(-self.grasps_per_pose // self.chunk)

    def quota(self, shard: int) -> int:
        """Return the number of grasps wanted of a shard."""
        return min(self.chunk, self.grasps_per_pose - shard * self.chunk)

    def as_json(self) -> Fields:
        """Return the settings as JSON holds them; meshes by their file name (their content is hashed apart)."""
        return asdict(self) | {"objects": [object_name(name) for name in self.objects]}


def versions() -> dict[str, str]:
    """Return the versions of packages that the last bits of grasps may depend on."""
    return {"python": platform.python_version()} | package_versions(
        ("dexgrasp", "numpy", "scipy", "numba", "daqp", "trimesh", "mujoco")
    )
