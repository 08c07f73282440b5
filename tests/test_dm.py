"""The dm_env view against the Gymnasium environment that it shows."""

import dm_env
import gymnasium as gym
import numpy as np
import pytest

from dexgrasp_env import dm
from dexgrasp_env.errors import InputError


@pytest.mark.parametrize("obs_mode", ["state", "pointcloud"])
def test_specs_hold(obs_mode):
    env = dm.load("sugar_box", seed=0, obs_mode=obs_mode)
    specs, action_spec = env.observation_spec(), env.action_spec()
    rng = np.random.default_rng(0)
    timestep = env.reset()
    assert timestep.first()
    assert timestep.reward is None
    for _ in range(3):
        assert set(specs) == set(timestep.observation)
        for key, spec in specs.items():
            spec.validate(timestep.observation[key])
        action = rng.uniform(-1, 1, action_spec.shape).astype(action_spec.dtype)
        action_spec.validate(action)
        timestep = env.step(action)
        env.reward_spec().validate(np.asarray(timestep.reward))
        env.discount_spec().validate(np.asarray(timestep.discount))
        assert timestep.mid()
        assert timestep.discount == 1.0


def test_same_rollout_as_gymnasium():
    env, other = dm.load("seen", seed=5, control_mode="ee_delta"), gym.make(
        "DexGrasp/Lift-v1", objects="seen", control_mode="ee_delta", disable_env_checker=True
    )  # fmt: skip
    timestep, (observation, _) = env.reset(), other.reset(seed=5)
    rng = np.random.default_rng(0)
    for _ in range(10):
        for key in observation:
            np.testing.assert_array_equal(timestep.observation[key], observation[key])
        action = rng.uniform(-1, 1, 22)
        timestep = env.step(action)
        observation, reward, *_ = other.step(action)
        assert timestep.reward == reward
    assert env.info["stage"] == "untouched"


def test_truncation_keeps_the_discount():
    env = dm.load("sugar_box", seed=0, max_episode_steps=3)
    env.reset()
    steps = [env.step(np.zeros(23)) for _ in range(3)]
    assert [step.step_type for step in steps] == [dm_env.StepType.MID] * 2 + [dm_env.StepType.LAST]
    assert steps[-1].discount == 1.0
    assert env.step(np.zeros(23)).first()  # the next step starts an episode


def test_termination_ends_the_discount():
    env = dm.load("sugar_box", seed=0)
    env.reset()
    env.gym_env.unwrapped.simulation.data.qvel[25] = 1e12
    timestep = env.step(np.zeros(23))
    assert timestep.last()
    assert timestep.discount == 0.0


def test_step_without_reset_starts_an_episode():
    assert dm.load("sugar_box").step(np.zeros(23)).first()


def test_wrong_arguments():
    with pytest.raises(InputError, match="obs_mode"):
        dm.load("sugar_box", obs_mode="pixels")
