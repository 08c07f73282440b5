"""LiftGentle-v0: the largest force of a finger is told, and ends the episode where it is too large."""

import gymnasium as gym
import numpy as np
from refusals import refused

from dexgrasp.agent import public_info
from dexgrasp.evaluation.protocol import TrialSeeds, get_protocol
from dexgrasp.evaluation.trial import run_trial
from dexgrasp.registry import make_agent
from dexgrasp_env.tasks.records import PRESSES


def made(agent, **more):
    return gym.make(
        "DexGrasp/LiftGentle-v0", objects="sugar_box", disable_env_checker=True, **agent.env_settings, **more
    )


def test_the_limit_is_told_and_a_squeeze_crushes():
    agent = make_agent("hardcoded")
    env = made(agent, max_force=2.0)
    env.reset(seed=3)
    assert public_info(env, {})["max_force"] == 2.0
    outcome, _ = run_trial(env, agent, TrialSeeds(3, 0))
    assert (outcome.success, outcome.reason) == (False, "crushed")
    assert outcome.steps < 150  # it ends there
    with refused("backend is 'warp': valid is mujoco"):
        made(agent, backend="warp")


def test_the_peak_is_that_of_all_physics_steps_single_and_many():
    agent = make_agent("hardcoded")
    env, many = made(agent, max_force=50.0), None
    observation, info = env.reset(seed=3)
    many = gym.make_vec(
        "DexGrasp/LiftGentle-v0", num_envs=1, objects="sugar_box", max_force=50.0, **agent.env_settings
    )
    many.reset(seed=3)
    agent.reset(observation, public_info(env, info))
    at, peak = env.unwrapped.simulation.columns[PRESSES], 0.0
    for _ in range(120):
        action = agent.act(observation)
        observation, _, _, _, info = env.step(action)
        *_, infos = many.step(action[None])
        sensors = env.unwrapped.data.sensordata[at : at + 12].reshape(4, 3)
        peak = max(peak, np.linalg.norm(sensors, axis=1).max())
        assert info["peak_force"] == infos["peak_force"][0] >= peak - 1e-9
    assert peak > 2.0
    assert not info["is_crushed"]
    state = env.unwrapped.get_state()
    env.reset(seed=4)
    env.unwrapped.set_state(state)
    assert env.unwrapped.observe()[1]["peak_force"] == info["peak_force"]


def test_a_protocol_of_any_number():
    assert get_protocol("gentle@8").scene == {"max_force": 8}
    assert get_protocol("gentle@2.5").scene == {"max_force": 2.5}
    for name in ("gentle", "gentle@", "gentle@a", "soft@8"):
        with refused("valid are"):
            get_protocol(name)
