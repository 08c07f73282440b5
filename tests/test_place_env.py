"""Place-v1: goals, rewards of other goals, and a learner that relabels them."""

import copy
import re

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp_env.errors import InputError
from dexgrasp_env.tasks.place import PlaceEnv


def make(**kwargs):
    return gym.make("DexGrasp/Place-v1", **{"objects": "sugar_box", **kwargs})


def test_checker_accepts_it():
    check_env(make().unwrapped, skip_render_check=True)


def test_page_lists_the_spaces():
    rows = re.findall(r"\| `(\w+)` \| (\(\d+,\)) \| (\w+) \|", PlaceEnv.__doc__)
    space = make(disable_env_checker=True).observation_space
    assert {name: (shape, kind) for name, shape, kind in rows} == {
        name: (str(part.shape), str(part.dtype)) for name, part in space.items()
    }


def test_goals_are_drawn_above_the_table_and_by_the_seed():
    env = make(disable_env_checker=True)
    goals = [env.reset(seed=seed)[0]["desired_goal"] for seed in (0, 1, 2, 0)]
    assert np.array_equal(goals[0], goals[3])
    assert not np.array_equal(goals[0], goals[1])
    for x, y, z in goals:
        assert 0.42 <= x <= 0.60
        assert -0.20 <= y <= 0.20
        assert 0.15 <= z <= 0.35


@pytest.mark.parametrize("reward_mode", ["sparse", "dense"])
def test_reward_is_that_of_compute_reward(reward_mode):
    env = make(reward_mode=reward_mode)
    env.reset(seed=0)
    observation, reward, _, _, info = env.step(np.zeros(23))
    achieved, desired = observation["achieved_goal"], observation["desired_goal"]
    inner = env.unwrapped
    assert inner.compute_reward(achieved, desired, info) == reward
    goals = achieved + np.array([[0, 0, 0], [0, 0, 0.029], [0, 0.031, 0]])
    rewards = inner.compute_reward(np.stack([achieved] * 3), goals, [info] * 3)
    expected = [0, 0, -1] if reward_mode == "sparse" else [0, -0.029, -0.031]
    np.testing.assert_allclose(rewards, expected, atol=1e-6)


def test_success_is_a_second_at_the_goal():
    env = make(disable_env_checker=True)
    env.reset(seed=0)
    inner = env.unwrapped
    inner._episodes.records["goal"][0] = inner.data.qpos[23:26]
    told = [env.step(np.zeros(23))[4]["is_success"] for _ in range(21)]
    assert told == [False] * 19 + [True] * 2
    again = copy.deepcopy(env)  # the goal is part of the state
    assert np.array_equal(
        again.step(np.zeros(23))[0]["desired_goal"], env.step(np.zeros(23))[0]["desired_goal"]
    )


def test_wrong_arguments():
    for kwargs in ({"obs_mode": "depth"}, {"disturbance": "pushed"}):
        with pytest.raises(InputError, match="Place"):
            make(**kwargs)


def test_hindsight_replay_runs():
    sb3 = pytest.importorskip("stable_baselines3")
    env = make(control_mode="ee_delta", max_episode_steps=20)
    model = sb3.SAC(
        "MultiInputPolicy", env, replay_buffer_class=sb3.HerReplayBuffer, learning_starts=60, batch_size=32,
        train_freq=8, gradient_steps=1, seed=0, device="cpu", policy_kwargs={"net_arch": [16]},
    )  # fmt: skip
    model.learn(120)
    assert model.num_timesteps >= 120
