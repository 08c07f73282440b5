"""What advances many environments: MuJoCo on all cores, or mujoco_warp on a GPU."""

from functools import partial
from typing import TYPE_CHECKING, Any

from dexgrasp_env.tasks.batch import BatchPhysics
from dexgrasp_env.tasks.rests import Rests

if TYPE_CHECKING:
    from dexgrasp_env.tasks.episodes import Episodes
    from dexgrasp_env.tasks.warp_batch import WarpPhysics


def make_physics(
    episodes: "Episodes", number: int, threads: int | None = None
) -> "BatchPhysics | WarpPhysics":
    """Return the physics of environments, as their settings choose it.

    Args:
        episodes: theirs.
        number: of environments.
        threads: of MuJoCo, at most so many at a time; None for one a core.

    Raises:
        InputError: for what warp does not do, a missing extra or device.
    """
    settings, scenes = episodes.settings, episodes.simulations.values()
    if settings.backend == "mujoco":
        return BatchPhysics(scenes, number, threads, episodes.neighbours)
    from dexgrasp_env.tasks.warp_batch import WarpPhysics

    around = list(settings.load_objects(episodes.around).values())
    neighbours = around, episodes.neighbours, episodes.walled
    return WarpPhysics(scenes, number, settings.device, settings.frame_skip, *neighbours)


def use_device(episodes: "Episodes", physics: Any, tensors: bool) -> None:
    """Have episodes kept on the device of their `WarpPhysics`, and cameras look there; see `WarpEpisodes`."""
    from dexgrasp_env.sensing.warp_rays import WarpCameras
    from dexgrasp_env.tasks.warp_episodes import WarpEpisodes

    # Resets by MuJoCo would take longer than the steps of the others.
    episodes.one_model, episodes.settle = True, Rests().settle
    episodes.device = WarpEpisodes(episodes, physics, tensors)
    episodes.views.rays = partial(WarpCameras, device=physics.device)


def give_physics(episodes: "Episodes") -> None:
    """Have the scenes of a single environment advanced as its settings choose; raises as `make_physics`."""
    if episodes.settings.backend != "mujoco":
        physics = make_physics(episodes, 1)
        for simulation in episodes.simulations.values():
            simulation.physics = physics
