"""Placing: a grasp that goes on to a goal, and lets go where the object is to lie."""

import gymnasium as gym
import numpy as np
import pytest
from foreign_parts import six_joint_arm

from dexgrasp.agent import public_info
from dexgrasp.agents.placing import PlacingAgent
from dexgrasp.evaluation.protocol import PROTOCOLS, TrialSeeds
from dexgrasp.evaluation.trial import run_trial
from dexgrasp.registry import make_agent, placing_agent
from dexgrasp_env.robot.make import make_robot


@pytest.mark.parametrize("goal", [[0.58, -0.1, 0.30, 1.0], [0.45, 0.15, 0.04, 0.0]])
def test_an_agents_grasp_is_carried_to_the_goal(goal):
    agent = placing_agent("hardcoded")
    env = gym.make("DexGrasp/Place-v2", objects="sugar_box", disable_env_checker=True, **agent.env_settings)
    observation, info = env.reset(seed=2, options={"goal": goal})
    agent.reset(observation, public_info(env, info))
    for _ in range(300):
        observation, reward, _, truncated, info = env.step(agent.act(observation))
        if truncated or info["is_success"]:
            break
    assert info["is_success"]
    assert reward == 0.0
    np.testing.assert_allclose(env.unwrapped.data.qpos[23:25], goal[:2], atol=0.03)
    for _ in range(20):  # and stays
        *_, info = env.step(agent.act(observation))
    assert info["is_success"]


def test_trials_say_that_the_goal_was_missed():
    agent = placing_agent("random")
    env = gym.make(
        PROTOCOLS["place"].env_id, objects="sugar_box", max_episode_steps=3, disable_env_checker=True
    )
    outcome, _ = run_trial(env, agent, TrialSeeds(0, 0))
    assert outcome.reason == "not_touched"
    agent = placing_agent("hardcoded")
    env = gym.make(
        "DexGrasp/Place-v2", objects="sugar_box", max_episode_steps=60, disable_env_checker=True,
        **agent.env_settings,
    )  # fmt: skip
    assert run_trial(env, agent, TrialSeeds(0, 0))[0].reason == "not_at_goal"


def test_fingers_that_move_on_an_arm_of_six_joints_are_no_arm_that_does(tmp_path):
    make_robot(None, six_joint_arm(tmp_path), tmp_path / "six.yaml")
    agent = PlacingAgent(make_agent("random"))
    env = gym.make(
        "DexGrasp/Place-v2", objects="sugar_box", robot=str(tmp_path / "six.yaml"), obs_mode="pointcloud",
        disable_env_checker=True,
    )  # fmt: skip
    observation, info = env.reset(seed=0)
    agent.reset(observation, public_info(env, info))
    home = env.unwrapped.settings.cell.robot.home
    for joint, away in ((6, False), (5, True)):
        moved = home + 0.2 * np.eye(len(home))[joint]
        agent.act(observation | {"joint_targets": moved, "joint_positions": home})
        assert (agent._low is not None) == away
    low, agent._low = agent._low, home
    agent._goal = np.array([*agent._middle, 0.0])
    opened = list(agent._deliver(low + 0.1 * np.eye(len(home))[6]))[-1]
    np.testing.assert_array_equal(opened[6:], home[6:])
