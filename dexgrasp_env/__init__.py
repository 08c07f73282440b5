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

from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError
from dexgrasp_env.tasks.constants import MAX_EPISODE_STEPS
from dexgrasp_env.yaml_file import read_yaml

__all__ = ["InputError"]
__version__ = "0.4.0"


def _register(name: str, task: str = "lift:Lift", **told: Any) -> None:
    # The entry points are strings so that specs serialise.
    register(
        id=f"DexGrasp/{name}", entry_point=f"dexgrasp_env.tasks.{task}Env",
        vector_entry_point=f"dexgrasp_env.tasks.vector:{task.partition(':')[2]}VectorEnv",
        **{"max_episode_steps": MAX_EPISODE_STEPS, "reward_threshold": 75.0} | told,
    )  # fmt: skip


for each, known in read_yaml(asset_path("environments.yaml")).items():
    _register(each, **known)
