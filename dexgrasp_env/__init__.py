"""Dexterous grasping on a table: Gymnasium environments for a Panda arm with an Allegro hand.

Importing the package registers the environments; it brings no torch, no numba and no GL.
"""

import sys
from typing import Any

if sys.argv[:1] == ["-m"] and "dexgrasp_env" in sys.orig_argv:
    # `python -m dexgrasp_env`: what asks the command to stop waits until it can listen.
    import signal

    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))

from gymnasium.envs.registration import register

from dexgrasp_env.errors import InputError

__all__ = ["InputError"]
__version__ = "0.3.0"

_LIMIT = 300  # control steps at 20 Hz: 15 s
_PUSHES = 80  # control steps that the pushes take: `tasks.disturbance`, which is not imported here
_SOLVED = 220.0  # dense return: held grasps reach 239, squeezing without lifting at most 168


def _register(name: str, max_episode_steps: int = _LIMIT, **kwargs: Any) -> None:
    # The entry points are strings so that specs serialise.
    register(
        id=f"DexGrasp/{name}", entry_point="dexgrasp_env.tasks.lift:LiftEnv",
        vector_entry_point="dexgrasp_env.tasks.vector:LiftVectorEnv", max_episode_steps=max_episode_steps,
        reward_threshold=_SOLVED, kwargs=kwargs,
    )  # fmt: skip


_register("Lift-v1")
_register("LiftUpright-v1", presentation="upright")
_register("LiftSlippery-v1", friction=0.35)
_register("LiftPushed-v1", _LIMIT + _PUSHES, friction=0.5, disturbance={"kind": "pushed", "size": 0.5})
_register("LiftOneView-v1", obs_mode="pointcloud", views=1)

register(
    id="DexGrasp/Place-v1", entry_point="dexgrasp_env.tasks.place:PlaceEnv",
    vector_entry_point="dexgrasp_env.tasks.vector:PlaceVectorEnv", max_episode_steps=_LIMIT,
)  # fmt: skip
