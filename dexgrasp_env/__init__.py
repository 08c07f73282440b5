"""Dexterous grasping on a table: Gymnasium environments for a Panda arm with an Allegro hand.

Importing the package registers the environments; it brings no torch, no numba and no GL.
"""

import ctypes
import os
import sys
from typing import Any

if sys.argv[:1] == ["-m"] and "dexgrasp_env" in sys.orig_argv:
    # `python -m dexgrasp_env`: what asks the command to stop waits until it can listen.
    import signal

    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))

if os.environ.get("MUJOCO_GL", "").strip().lower() == "osmesa" and "mujoco" not in sys.modules:
    # Where there is no OSMesa `import mujoco` would raise, even for what draws nothing.
    try:
        ctypes.CDLL("libOSMesa.so.8")
    except OSError:
        os.environ["DEXGRASP_GL"] = os.environ.pop("MUJOCO_GL")

from gymnasium.envs.registration import register

from dexgrasp_env.errors import InputError
from dexgrasp_env.tasks.constants import (
    CLEAR_STEPS,
    CLUTTER_EPISODE_STEPS,
    HEAP_EPISODE_STEPS,
    MAX_EPISODE_STEPS,
)

__all__ = ["InputError"]
__version__ = "0.3.0"

_PUSHES = 80  # control steps that the pushes take: `tasks.disturbance`, which is not imported here
_SOLVED = 75.0  # dense return: without success 50 at most


_SCALE = 0.2  # of the rewards of tasks for plain learners: returns from 0 to 20


def _register(name: str, max_episode_steps: int = MAX_EPISODE_STEPS, **kwargs: Any) -> None:
    # The entry points are strings so that specs serialise.
    register(
        id=f"DexGrasp/{name}", entry_point="dexgrasp_env.tasks.lift:LiftEnv",
        vector_entry_point="dexgrasp_env.tasks.vector:LiftVectorEnv", max_episode_steps=max_episode_steps,
        reward_threshold=_SOLVED * kwargs.get("reward_scale", 1.0), kwargs=kwargs,
    )  # fmt: skip


_register("Lift-v2")
_register("LiftUpright-v2", presentation="upright")
_register("LiftSlippery-v2", friction=0.35)
_register(
    "LiftPushed-v2", MAX_EPISODE_STEPS + _PUSHES, friction=0.5, disturbance={"kind": "pushed", "size": 0.5}
)
_register("LiftOneView-v2", obs_mode="pointcloud", views=1)
_register("LiftOnce-v0", obs_mode="features", control_mode="grasp_once", reward_scale=_SCALE)
_register(
    "LiftVaried-v0", obs_mode="features", control_mode="table_grasp_once", reward_scale=_SCALE, objects="drawn-0..39",
    object_pose={"rest_pose": "each"}, randomisation={"friction": (0.3, 0.9), "mass": (1.0, 4.0)},
)  # fmt: skip
_register(
    "LiftFromGrasp-v0", 80, obs_mode="features", control_mode="ee_delta", hold=2, reward_scale=_SCALE,
    starts="pregrasps",
)  # fmt: skip
_register("LiftStaged-v0", 6, obs_mode="features", control_mode="grasp", hold=28, reward_scale=_SCALE)

for name, count, gaps, limit in (
    ("Sparse", (4, 8), (0.02, 0.05), CLUTTER_EPISODE_STEPS),
    ("Dense", (9, 15), (0.005, 0.02), CLUTTER_EPISODE_STEPS),
    ("Heap", 8, None, HEAP_EPISODE_STEPS),
):
    register(
        id=f"DexGrasp/Clutter{name}-v1", entry_point="dexgrasp_env.tasks.clutter_env:ClutterEnv",
        vector_entry_point="dexgrasp_env.tasks.vector:ClutterVectorEnv", max_episode_steps=limit,
        reward_threshold=_SOLVED, kwargs={"neighbours": count, "gaps": gaps},
    )  # fmt: skip

register(
    id="DexGrasp/LiftGentle-v0", entry_point="dexgrasp_env.tasks.gentle:GentleEnv",
    vector_entry_point="dexgrasp_env.tasks.vector_tasks:GentleVectorEnv", max_episode_steps=MAX_EPISODE_STEPS,
    reward_threshold=_SOLVED,
)  # fmt: skip
register(
    id="DexGrasp/Clear-v0", entry_point="dexgrasp_env.tasks.clear:ClearEnv",
    vector_entry_point="dexgrasp_env.tasks.vector_tasks:ClearVectorEnv", max_episode_steps=8 * CLEAR_STEPS,
)  # fmt: skip
register(
    id="DexGrasp/Place-v2", entry_point="dexgrasp_env.tasks.place:PlaceEnv",
    vector_entry_point="dexgrasp_env.tasks.vector:PlaceVectorEnv", max_episode_steps=MAX_EPISODE_STEPS,
)  # fmt: skip
