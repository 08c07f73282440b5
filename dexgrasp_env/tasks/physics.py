"""Choice of the physics of environments: MuJoCo on all cores, or mujoco_warp on a GPU."""

from functools import partial
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import quat_conjugate, quat_multiply, rotate
from dexgrasp_env.scene.constants import TABLE_CENTRE_X
from dexgrasp_env.tasks.batch import BatchPhysics
from dexgrasp_env.tasks.simulation import Simulation

if TYPE_CHECKING:
    from dexgrasp_env.tasks.episodes import Episodes
    from dexgrasp_env.tasks.warp_batch import WarpPhysics


_DIGITS = 6  # of a height in m and of a direction, within which two starts are one


class SettleCache:
    """Settled states, one for each side that an object is put down on: a look-up takes 1 % of what settling takes.

    Masses, friction and servos as they are drawn change by micrometres how an object comes to lie; here it settles as
    it is built.
    """

    def __init__(self) -> None:
        self._kept: dict[tuple[Simulation, bytes], tuple[Array, ...]] = {}

    def settle(self, simulation: Simulation) -> None:
        """Do what `Simulation.settle` does with an object that has just been placed, the robot being home."""
        if simulation.variation.size != 1.0:
            simulation.settle()
            return
        pose = simulation.object_pose()
        up = rotate(quat_conjugate(pose[3:]), np.array([0.0, 0.0, 1.0]))
        key = simulation, np.round([*up, pose[2]], _DIGITS).tobytes()
        if key not in self._kept:
            self._kept[key] = _settled(simulation, up, pose[2])
        _move(simulation, pose, *self._kept[key])


def _settled(simulation: Simulation, up: Array, height: float) -> tuple[Array, ...]:
    """Settle the object as it is built in the middle of the table, turned there from `up` by the shortest way.

    Returns:
        The object's pose (7,) before, and positions and velocities of the scene after.
    """
    turn = np.array([1.0 + up[2], up[1], -up[0], 0.0])
    length = np.linalg.norm(turn)
    quat = turn / length if length > 1e-6 else np.array([0.0, 1.0, 0.0, 0.0])
    start = np.array([TABLE_CENTRE_X, 0.0, height, *quat])
    varied, simulation.model = simulation.model, simulation.base
    simulation.place(start)
    simulation.settle()
    simulation.model = varied
    return start, simulation.data.qpos.copy(), simulation.data.qvel.copy()


def _move(simulation: Simulation, pose: Array, start: Array, qpos: Array, qvel: Array) -> None:
    """Put the scene into a settled state that began at another place and turned otherwise about the vertical."""
    simulation.place(pose)
    data, n = simulation.data, simulation.cell.robot.dof
    turn = quat_multiply(pose[3:], quat_conjugate(start[3:]))
    data.qpos[:n], data.qvel[:] = qpos[:n], qvel
    data.qpos[n : n + 3] = pose[:3] + rotate(turn, qpos[n : n + 3] - start[:3])
    data.qpos[n + 3 :] = quat_multiply(turn, qpos[n + 3 :])
    data.qvel[n : n + 3] = rotate(turn, qvel[n : n + 3])  # the rotation's is in the object's frame
    mujoco.mj_forward(simulation.model, data)


def make_physics(episodes: "Episodes", threads: int | None = None) -> "BatchPhysics | WarpPhysics":
    """Return the physics of environments, as their settings choose it.

    Args:
        episodes: theirs.
        threads: of MuJoCo, at most so many at a time; None for one a core.

    Raises:
        InputError: for what warp does not do, a missing extra or device.
    """
    if episodes.settings.backend == "mujoco":
        return BatchPhysics(episodes.simulations.values(), len(episodes.slots), threads, episodes.neighbours)
    from dexgrasp_env.tasks.warp_batch import WarpPhysics

    return WarpPhysics(episodes)


def use_device(episodes: "Episodes", physics: Any, tensors: bool) -> None:
    """Move episodes and cameras to the device of their `WarpPhysics`; see `WarpEpisodes`."""
    from dexgrasp_env.sensing.warp_rays import WarpCameras
    from dexgrasp_env.tasks.warp_episodes import WarpEpisodes

    # Resets by MuJoCo would take longer than the steps of the others.
    episodes.one_model, episodes.settle = True, SettleCache().settle
    episodes.device = WarpEpisodes(episodes, physics, tensors)
    episodes.views.rays = partial(WarpCameras, device=physics.device)


def give_physics(episodes: "Episodes") -> None:
    """Give the scenes of a single environment the physics that its settings choose; raises as `make_physics`."""
    if episodes.settings.backend != "mujoco":
        physics = make_physics(episodes)
        for simulation in episodes.simulations.values():
            simulation.physics = physics
