"""Dexterous grasping on a table: Gymnasium environments for a Panda arm with an Allegro hand.

Importing the package registers the environments; it brings no torch, no numba and no GL.
"""

import sys

if sys.argv[:1] == ["-m"] and "dexgrasp_env" in sys.orig_argv:
    # `python -m dexgrasp_env`: what asks the command to stop waits until it can listen.
    import signal

    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))

from gymnasium.envs.registration import register

from dexgrasp_env.errors import InputError

__all__ = ["InputError"]
__version__ = "0.1.0"

# The entry point is a string so that specs serialise. 300 control steps at 20 Hz are 15 s.
register(id="DexGrasp/Lift-v0", entry_point="dexgrasp_env.tasks.lift:LiftEnv", max_episode_steps=300)
