"""Environments of mujoco_warp beside MuJoCo's, for their tests."""

import os

import gymnasium as gym

from dexgrasp_env.tasks.constants import SETTLE_STEPS

ID = "DexGrasp/Lift-v2"
N = 40  # of every environment here: a kernel is compiled for each number of worlds
WARP = {"backend": "warp", "device": os.environ.get("DEXGRASP_WARP_DEVICE", "cpu")}  # cuda:0 on a GPU


def make(backend, objects="all20", env_id=ID, **kwargs):
    """Make environments in which every object settles for itself: the physics alone differ."""
    given = WARP if backend == "warp" else {}
    envs = gym.make_vec(env_id, num_envs=N, objects=objects, **given, **kwargs)
    envs.unwrapped._episodes.settle_steps = SETTLE_STEPS
    return envs
