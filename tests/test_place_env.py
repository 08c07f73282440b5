"""Place-v2: goals, rewards of other goals, and a learner that relabels them."""

import re

import gymnasium as gym
import numpy as np
import pytest
from lift_envs import judge
from numpy.testing import assert_allclose
from refusals import refused
from tables import table

from dexgrasp_env.tasks.infos import infos_of
from dexgrasp_env.tasks.place import PlaceEnv


def make(**kwargs):
    return gym.make("DexGrasp/Place-v2", **{"objects": "sugar_box", **kwargs})


def test_page_lists_the_spaces():
    rows = re.findall(r"\| `(\w+)` \| (\(\d+,\)) \| (\w+) \|", PlaceEnv.__doc__)
    space = make(disable_env_checker=True).observation_space
    assert {name: (shape, kind) for name, shape, kind in rows} == {
        name: (str(part.shape), str(part.dtype)) for name, part in space.items()
    }


def test_goals_are_drawn_above_the_table_and_by_the_seed():
    env = make(disable_env_checker=True)
    seen = [env.reset(seed=seed)[0] for seed in (*range(40), 0)]
    goals, lies = ([one[f"{kind}_goal"] for one in seen] for kind in ("desired", "achieved"))
    assert np.array_equal(goals[0], goals[40])
    assert not np.array_equal(goals[0], goals[1])
    for (x, y, z, hand), at in zip(goals, lies, strict=True):
        assert 0.42 <= x <= 0.60
        assert -0.20 <= y <= 0.20
        assert at[3] == -1.0  # not moved
        if hand:
            assert at[2] + 0.049 <= z <= 0.35
        else:
            assert z == pytest.approx(at[2], abs=1e-6)
            assert np.hypot(x - at[0], y - at[1]) >= 0.099
    assert 10 <= sum(goal[3] for goal in goals) <= 30


def test_goals_can_be_given():
    env = make(disable_env_checker=True)
    goal = [0.5, 0.1, 0.2, 1.0]
    assert_allclose(env.reset(seed=0, options={"goal": goal})[0]["desired_goal"], goal, atol=1e-6)
    state = env.unwrapped.get_state()
    other = [0.45, 0.0, 0.1, 0.0]
    again = env.reset(options={"state": state, "goal": other})[0]["desired_goal"]
    assert_allclose(again, other, atol=1e-6)
    far, at = [0.5, 0.1, 3.0, 1.0], [0.5, 0.1, 0.2]
    for wrong in (at, far, [0.5, 0.1, np.nan, 1.0], "abc", [goal] * 2, [*at, 0.5], [*at, -1.0]):
        with refused("goal"):
            env.reset(options={"goal": wrong})


def test_a_goal_that_is_given_has_not_been_reached_before():
    env = make(disable_env_checker=True)
    env.reset(seed=0)
    env.unwrapped._episodes.task_records["moved"][0] = True
    env.unwrapped._episodes.task_records["goal"][0] = [*env.unwrapped.data.qpos[23:26], 0.0]
    for _ in range(20):
        told = env.step(np.zeros(23))[4]
    assert told["is_success"]
    state = env.unwrapped.get_state()
    assert env.reset(options={"state": state})[1]["is_success"]
    assert not env.reset(options={"state": state, "goal": [0.45, 0.0, 0.2, 1.0]})[1]["is_success"]
    same = state.task_record["goal"].tolist()
    env.reset(options={"state": state, "goal": same})
    told = [env.step(np.zeros(23))[4]["is_success"] for _ in range(20)]
    assert told == [False] * 19 + [True]


@pytest.mark.parametrize("reward_mode", ["sparse", "dense"])
def test_where_the_object_is_nowhere_no_goal_is_reached(reward_mode):
    env = make(reward_mode=reward_mode).unwrapped
    env.reset(seed=0)
    env.data.qpos[23] = np.nan
    observation, episodes = judge(env), env._episodes
    achieved, desired = observation["achieved_goal"], observation["desired_goal"]
    assert np.isfinite(achieved).all()
    assert episodes.rewards[0] == env.compute_reward(achieved, desired, {}) < 0.0
    assert np.isfinite(infos_of(episodes)["goal_distance"]).all()
    assert env.compute_reward(np.full_like(desired, np.nan), desired, {}) != 0.0


def test_hindsight_finds_its_goals_in_the_space_and_none_that_was_always_reached():
    env = make(disable_env_checker=True)
    seen, _ = env.reset(seed=0)
    space = env.observation_space["desired_goal"]
    assert space.contains(seen["achieved_goal"])
    lying = np.stack([seen["achieved_goal"]] * 3)
    assert env.unwrapped.compute_reward(lying, lying, {}).tolist() == [-1.0] * 3
    env.unwrapped.data.qpos[23:26] += [0.0, 0.05, 0.3]  # moved
    judge(env.unwrapped)
    achieved = env.unwrapped.observe()[0]["achieved_goal"]
    assert space.contains(achieved)
    assert env.unwrapped.compute_reward(achieved, achieved, {}) == 0.0
    env.unwrapped.data.qpos[23] = 9.0  # lost
    assert space.contains(env.step(np.zeros(23))[0]["achieved_goal"])


@pytest.mark.parametrize("reward_mode", ["sparse", "dense"])
def test_reward_is_that_of_compute_reward(reward_mode):
    env = make(reward_mode=reward_mode)
    env.reset(seed=0)
    observation, reward, _, _, info = env.step(np.zeros(23))
    achieved, desired = observation["achieved_goal"], observation["desired_goal"]
    inner = env.unwrapped
    assert inner.compute_reward(achieved, desired, info) == reward
    at = np.array([0.5, 0.0, 0.2, 1.0], np.float32)
    goals = at + np.array(table("near_goals"))
    rewards = inner.compute_reward(np.stack([at] * 4), goals, [info] * 4)
    expected = [0, 0, -1, -1] if reward_mode == "sparse" else [0, -0.029, -0.031, -0.05]
    assert_allclose(rewards, expected, atol=1e-6)


def test_wrong_arguments():
    with refused("a task of lifting"):
        make(disturbance="pushed")
