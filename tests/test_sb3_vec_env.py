"""The adapter to stable-baselines3: terminal observations, time limits, a learner on it."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import gymnasium as gym
from stable_baselines3 import PPO

from agents.learning.sb3_vec_env import SB3VecEnv


def test_terminal_observations_and_time_limits():
    env = SB3VecEnv("DexGrasp/Lift-v1", num_envs=2, objects="sugar_box", max_episode_steps=3)
    single = gym.make("DexGrasp/Lift-v1", objects="sugar_box", max_episode_steps=3, disable_env_checker=True)
    env.seed(5)
    first = env.reset()
    expected, _ = single.reset(seed=6)  # the second environment's
    assert all(np.array_equal(first[key][1], expected[key]) for key in expected)
    for step in range(3):
        last, *_ = single.step(np.zeros(23))
        observation, _, done, infos = env.step(np.zeros((2, 23)))
        assert done.tolist() == [step == 2] * 2
    assert infos[1]["TimeLimit.truncated"] is True
    assert all(np.array_equal(infos[1]["terminal_observation"][key], last[key]) for key in last)
    expected, _ = single.reset()
    assert all(np.array_equal(observation[key][1], expected[key]) for key in expected)
    assert env.env_is_wrapped(gym.Wrapper) == [False, False]
    env.close()


def test_ppo_learns_on_it():
    env = SB3VecEnv("DexGrasp/Lift-v1", num_envs=4, objects="sugar_box", max_episode_steps=10)
    model = PPO("MultiInputPolicy", env, n_steps=16, batch_size=32, n_epochs=1, seed=0, device="cpu")
    model.learn(64)
    assert model.num_timesteps == 64
    env.close()
