"""The adapter to stable-baselines3: terminal observations, time limits, a learner on it."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import gymnasium as gym
from refusals import refused
from stable_baselines3 import SAC, HerReplayBuffer

from dexgrasp.learning.reinforcement.sb3_vec_env import SB3VecEnv


def test_terminal_observations_and_time_limits():
    env = SB3VecEnv("DexGrasp/Lift-v2", num_envs=2, objects="sugar_box", max_episode_steps=3)
    single = gym.make("DexGrasp/Lift-v2", objects="sugar_box", max_episode_steps=3, disable_env_checker=True)
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
    assert env.get_images() == [None, None]  # as of environments that draw nothing
    env.close()
    told = SB3VecEnv("DexGrasp/Lift-v2", num_envs=2, objects="sugar_box", info_columns=("stages",))
    told.reset()
    with refused("unknown name of info_columns 'stages' .the nearest is 'stage'"):
        told.step(np.zeros((2, 23)))


def test_options_are_of_the_next_reset():
    env = SB3VecEnv("DexGrasp/Lift-v2", num_envs=2, objects=["sugar_box", "soda"])
    names = []
    for options in ([{"object": "soda"}, {"object": "sugar_box"}], {"object": "soda"}, None):
        env.seed(6)
        env.set_options(options)
        observation = env.reset()
        names.append([info["object"] for info in env.reset_infos])
        assert observation["object_pose"][:, 2].min() > 0.0  # of episodes that have begun
    assert names == [["soda", "sugar_box"], ["soda", "soda"], ["sugar_box", "soda"]]
    env.set_options({"colour": "red"})
    with refused("unknown reset option 'colour'"):
        env.reset()
    env.close()


def test_attributes_and_methods_are_of_each():
    env = SB3VecEnv("DexGrasp/Place-v2", num_envs=3, objects=["sugar_box", "soda"], render_mode="rgb_array")
    env.seed(4)
    env.reset()
    assert env.get_attr("dt", indices=[2]) == [0.05]
    assert env.render_mode == "rgb_array"
    with pytest.raises(AttributeError, match="valid are"):
        env.get_attr("speed")
    env.set_attr("level", 2, indices=[0, 2])
    env.set_attr("level", 5, indices=1)
    assert env.get_attr("level") == [2, 5, 2]
    state = env.env_method("get_state", indices=[1])[0]
    env.env_method("set_state", state, indices=0)
    assert env.get_attr("target")[0] == env.get_attr("target")[1]
    env.close()


def goal_learner(env, **kwargs):
    return SAC(
        "MultiInputPolicy", env, replay_buffer_class=HerReplayBuffer, batch_size=32, seed=0, device="cpu",
        policy_kwargs={"net_arch": [16]}, **kwargs,
    )  # fmt: skip


def test_hindsight_replay_runs_on_it():
    env = SB3VecEnv("DexGrasp/Place-v2", num_envs=2, objects="sugar_box", max_episode_steps=8)
    model = goal_learner(env, learning_starts=40, train_freq=8, gradient_steps=1)
    model.learn(64)
    assert model.num_timesteps == 64
    env.close()
