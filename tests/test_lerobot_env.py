"""The suite as LeRobot's scripts want it; with LeRobot itself: `test_readers.py`."""

import gymnasium as gym
import numpy as np
from numpy.testing import assert_array_equal

import dexgrasp_env  # noqa: F401
from dexgrasp.evaluation.protocol import trial_seeds
from dexgrasp.learning.lerobot.env import LeRobotEnv, lerobot_observation

NEW = {"lerobot_new_rollout": True}


def lift(**settings):
    return LeRobotEnv(gym.make("DexGrasp/Lift-v2", objects="soda", **settings), "soda", seed=4)


def test_scenes_are_those_of_an_evaluations_trials():
    plain = gym.make("DexGrasp/Lift-v2", objects="soda")
    envs = gym.vector.SyncVectorEnv([lift] * 2, autoreset_mode=gym.vector.AutoresetMode.SAME_STEP)
    seen, _ = envs.reset(seed=[3, 7], options=NEW)
    for k, trial in enumerate((3, 7)):
        first, _ = plain.reset(seed=trial_seeds(4, "soda", trial).scene)
        assert_array_equal(seen["agent_pos"][k], first["joint_positions"])
        assert_array_equal(seen["environment_state"][k], lerobot_observation(first)["environment_state"])
        assert_array_equal(seen["environment_state"][k][1:8], first["object_pose"])
    assert envs.call("task_description") == ("lift soda",) * 2
    assert envs.call("_max_episode_steps") == (300, 300)
    assert np.stack(envs.call("render")).shape == (2, 64, 64, 3)
    action = np.full((2, 23), 0.3, np.float32)
    after, reward, *_, info = envs.step(action)
    alone = plain.step(action[1].astype(float))
    assert_array_equal(after["agent_pos"][1], alone[0]["joint_positions"])
    assert (reward[1], info["is_success"][1]) == (alone[1], False)


def test_an_episode_ends_with_success():
    env = lift()
    env.reset(seed=0)
    inner = env.env.step
    env.env.step = lambda action: (*inner(action)[:4], {**inner(action)[4], "is_success": True})
    assert env.step(np.zeros(23))[2]
