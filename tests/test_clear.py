"""Clear-v0: what is in the tray, what has fallen, what was touched; and agents that clear the table."""

import gymnasium as gym
import numpy as np
import pytest
from refusals import refused
from tables import mistakes, table

from dexgrasp.evaluation.protocol import TrialSeeds, get_protocol
from dexgrasp.evaluation.trial import run_trial
from dexgrasp.registry import placing_agent
from dexgrasp_env.tasks.clear import TRAY


def made(count=3, **more):
    return gym.make("DexGrasp/Clear-v0", count=count, disable_env_checker=True, **more)


def test_what_is_in_the_tray_and_what_has_fallen_is_counted_and_paid_for():
    env = made()
    observation, info = env.reset(seed=1)
    assert observation["neighbour_poses"].shape == (2, 7)
    assert [info[name] for name in ("objects", "in_tray", "off_table", "touched")] == [3, 0, 0, 0]
    np.testing.assert_array_equal(env.unwrapped.agent_info["tray"], TRAY)
    still, data = np.zeros(env.action_space.shape), env.unwrapped.data
    free = data.qpos[-21:].reshape(3, 7)
    total = 0.0
    for k, (place, told) in enumerate(table("cleared")):
        free[k, :3] = place
        for _ in range(2):
            _, reward, terminated, _, info = env.step(still)
            total += reward
        assert [info["in_tray"], info["off_table"]] == told
        assert (terminated, info["is_success"]) == (False, False)
    assert total == pytest.approx(1 / 3)
    state = env.unwrapped.get_state()
    free[2, :3] = (0.5, 0.47, 0.15)
    _, reward, *_, info = env.step(still)
    assert (info["is_success"], reward) == (True, pytest.approx(2 / 3))
    env.unwrapped.set_state(state)
    assert env.unwrapped.observe()[1]["off_table"] == 1


def test_mistakes_and_protocols():
    for wrong in mistakes("clear"):
        with refused():
            made(**{"count": 3} | wrong)
    clear = get_protocol("clear@5")
    assert (clear.scene, clear.places) == ({"count": 5, "max_episode_steps": 2000}, True)


def test_an_agent_clears_the_table():
    agent = placing_agent("hardcoded", "DexGrasp/Clear-v0")
    env = made(2, max_episode_steps=800, **agent.env_settings)
    outcome, _ = run_trial(env, agent, TrialSeeds(1, 0))
    assert outcome.success
    assert outcome.details["in_tray"] == 2
    lazy = placing_agent("random", "DexGrasp/Clear-v0")
    env = made(2, max_episode_steps=5, **lazy.env_settings)
    outcome, _ = run_trial(env, lazy, TrialSeeds(1, 0))
    assert (outcome.reason, outcome.details["in_tray"]) == ("not_all_in_tray", 0)
