"""Dexterous grasping on a table: Gymnasium environments for a Panda arm with an Allegro hand, or a robot of one's own.

A `robot` and `objects` become a `scene`; `sensing` and `perception` look at it; `tasks` are the environments. Importing
the package registers them; it brings no torch, no numba and no GL.
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
__version__ = "0.4.0"

_PLAIN: dict[str, Any] = {"obs_mode": "features", "reward_scale": 0.2, "reward_threshold": 15.0}
"""Of tasks for plain learners: returns from 0 to 20."""


def _register(
    name: str, max_episode_steps: int = MAX_EPISODE_STEPS, env: str = "lift:Lift",
    reward_threshold: float | None = 75.0, **kwargs: Any,
) -> None:  # fmt: skip
    # Without success the dense return is 50 at most. The entry points are strings so that specs serialise.
    register(
        id=f"DexGrasp/{name}", entry_point=f"dexgrasp_env.tasks.{env}Env",
        vector_entry_point=f"dexgrasp_env.tasks.vector:{env.partition(':')[2]}VectorEnv", kwargs=kwargs,
        max_episode_steps=max_episode_steps, reward_threshold=reward_threshold,
    )  # fmt: skip


_register("Lift-v2")
_register("LiftUpright-v2", presentation="upright")
_register("LiftSlippery-v2", friction=0.35)
# Pushes take 80 control steps: `tasks.disturbance`, which is not imported here.
_register("LiftPushed-v2", MAX_EPISODE_STEPS + 80, friction=0.5, disturbance={"kind": "pushed", "size": 0.5})
_register("LiftOneView-v2", obs_mode="pointcloud", views=1)
_register("LiftOnce-v0", control_mode="grasp_once", **_PLAIN)
_register("LiftFromGrasp-v0", 80, control_mode="ee_delta", hold=2, starts="pregrasps", **_PLAIN)
# Published trials name v0.
for version, reward in (("v0", _PLAIN), ("v1", {**_PLAIN, "reward_mode": "best"})):
    _register(f"LiftStaged-{version}", 6, control_mode="grasp", hold=28, **reward)
    _register(
        f"LiftVaried-{version}", control_mode="table_grasp_once", objects="drawn-0..39",
        object_pose={"rest_pose": "each"}, randomisation={"friction": (0.3, 0.9), "mass": (1.0, 4.0)},
        **reward,
    )  # fmt: skip

for name, count, gaps, limit in (
    ("Sparse", (4, 8), (0.02, 0.05), CLUTTER_EPISODE_STEPS),
    ("Dense", (9, 15), (0.005, 0.02), CLUTTER_EPISODE_STEPS),
    ("Heap", 8, None, HEAP_EPISODE_STEPS),
):
    _register(f"Clutter{name}-v1", limit, "clutter:Clutter", neighbours=count, gaps=gaps)

_register("Place-v2", env="place:Place", reward_threshold=None)
_register("LiftGentle-v0", env="gentle:Gentle")
_register("Clear-v0", 8 * CLEAR_STEPS, "clear:Clear", reward_threshold=None)
