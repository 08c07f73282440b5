"""Environments of mujoco_warp beside MuJoCo's, for their tests."""

import os

import gymnasium as gym
import mujoco
import numpy as np

import dexgrasp_env  # noqa: F401  (registers the environments)
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


def throw(scene, rng):
    """Bend the joints, and put the object at the palm or above the table, so that nothing is deeper than 1 cm."""
    robot, data = scene.cell.robot, scene.data
    while True:
        mujoco.mj_resetData(scene.model, data)
        bent = rng.uniform(robot.lower, robot.upper) - robot.home
        data.qpos[: robot.dof] = robot.home + rng.uniform(0.0, 1.0) * bent
        mujoco.mj_forward(scene.model, data)
        near = data.site(robot.hand.palm).xpos if rng.random() < 0.5 else [0.5, 0.0, 0.03]
        quat = rng.normal(size=4)
        data.qpos[robot.dof :] = [*(near + rng.normal(0.0, 0.04, 3)), *(quat / np.linalg.norm(quat))]
        mujoco.mj_forward(scene.model, data)
        if data.ncon and data.contact.dist.min() > -0.01:
            return data.ncon
