"""What advances many environments: MuJoCo on all cores, or mujoco_warp on a GPU."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.tasks.batch import BatchPhysics
from dexgrasp_env.tasks.settings import LiftSettings
from dexgrasp_env.tasks.simulation import Simulation

BACKENDS = ("mujoco", "warp")


class Physics(Protocol):
    """N environments; see `BatchPhysics`, whose attributes and arguments these are."""

    qpos: Array
    qvel: Array
    sensors: Array

    def load(self, i: int, simulation: Simulation) -> None:
        """Make environment `i` what a scene holds now."""

    def state(self, i: int) -> Array:
        """Return the full integration state of environment `i`."""

    def step(self, rows: Array, push: Array | None, which: NDArray[np.intp]) -> NDArray[np.int64]:
        """Advance environments by one control step, and return the warnings."""

    def close(self) -> None:
        """Free what is held."""


@dataclass(frozen=True)
class Backend:
    """Which physics, and where.

    Attributes:
        name: of `BACKENDS`.
        threads: of `mujoco`, at most so many at a time; None for one a core.
        device: of `warp`, as that names it; None for the first GPU.
    """

    name: str
    threads: int | None
    device: str | None


def make_physics(
    where: Backend, scenes: Iterable[Simulation], number: int, settings: LiftSettings, neighbours: int
) -> Physics:
    """Return the physics of `number` environments.

    Args:
        where: it runs.
        scenes: of one object, that environments share.
        number: of environments.
        settings: of the environments.
        neighbours: most that scenes have.

    Raises:
        InputError: for what warp does not do, a missing extra or device.
    """
    if where.name == "mujoco":
        return BatchPhysics(scenes, number, where.threads, neighbours)
    if settings.obs_mode != "state" or neighbours:
        raise InputError("backend='warp' has obs_mode='state' alone, and no neighbours: use backend='mujoco'")
    from dexgrasp_env.tasks.warp_batch import WarpPhysics

    return WarpPhysics(scenes, number, where.device or "cuda:0", settings.frame_skip)
