"""Lift environments and rollouts that several tests compare."""

import gymnasium as gym
import numpy as np
import pytest

from dexgrasp_env.rendering import choose_gl

ID = "DexGrasp/Lift-v2"
NEEDS_GL = {"rgbd"}


def make(**kwargs):
    return gym.make(ID, **{"objects": "sugar_box", **kwargs}, disable_env_checker=True)


def judge(env):
    """Judge and observe an environment as it stands, as after a step in which nothing moved."""
    nothing = np.zeros(1, np.int64)
    return env._episodes.conclude(slice(None), env.simulation, nothing, [env.np_random])


def few(name):
    """Options of an environment that lays few neighbours: a heap of eight takes seconds to come to rest."""
    return {"neighbours": 2} if "Clutter" in name else {}


def skip_without_gl(obs_mode):
    if obs_mode in NEEDS_GL and choose_gl() is None:
        pytest.skip("no GL library here")


def rollout(env, seed, steps=25, scale=0.5, options=None):
    """Observations, rewards and the last state of random actions."""
    rng = np.random.default_rng(seed)
    observation, _ = env.reset(seed=seed, options=options)
    seen, rewards = [observation], []
    for _ in range(steps):
        observation, reward, terminated, _, _ = env.step(rng.uniform(-scale, scale, env.action_space.shape))
        seen.append(observation)
        rewards.append(reward)
        if terminated:
            break
    return seen, rewards, env.unwrapped.simulation.data.qpos.copy()


def finished(env, agent, observation, steps=400):
    """Let an agent act until an episode ends or is solved; return the last info."""
    for _ in range(steps):
        observation, _, terminated, truncated, info = env.step(agent.act(observation))
        if terminated or truncated or info["is_success"]:
            break
    return info
