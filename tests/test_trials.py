"""Protocols and trials: seeds, what agents are told, agents that misbehave."""

from typing import ClassVar

import gymnasium as gym
import numpy as np
import pytest
from refusals import refused

from dexgrasp.agent import Agent, Report, renew_report
from dexgrasp.agents.placing import PlacingAgent
from dexgrasp.evaluation import trial as one_trial
from dexgrasp.evaluation.protocol import agent_settings, trial_seeds


class Still(Agent):
    """Asks for nothing and does nothing; remembers what it was told."""

    env_settings: ClassVar = {"control_mode": "joint_delta"}

    def reset(self, observation, info):
        self.info = info
        self.report = Report(planning_seconds=0.5)

    def act(self, observation):
        return np.zeros(23, np.float32)


class Breaks(Still):
    """Raises in the third step."""

    def act(self, observation):
        self.count = getattr(self, "count", 0) + 1
        if self.count == 3:
            raise ZeroDivisionError("on purpose")
        return super().act(observation)


class BreaksAtReset(Still):
    def reset(self, observation, info):
        raise KeyError("on purpose")


class Gives(Still):
    """Gives whatever it is told to."""

    action: ClassVar = None

    def act(self, observation):
        return self.action


class HasNoPlan(Still):
    def reset(self, observation, info):
        certificate = {
            "distances_cm": [-0.5, -0.4, -0.3],
            "force_ratio_percent": 1.0,
            "holds": False,
            "extra": np.nan,
        }
        self.report = Report(failure="no_grasp", planning_seconds=1.5, details={"certificate": certificate})


class FillsIn(Still):
    """Has no plan in its first trial, and says so in the report that it has."""

    trials = 0

    def reset(self, observation, info):
        self.trials += 1
        if self.trials == 1:
            self.report.failure = "no_grasp"


class Duck:
    """Not a subclass of anything."""

    def reset(self, observation, info):
        self.space = info["action_space"]

    def act(self, observation):
        return self.space.low


class Wants(Still):
    env_settings: ClassVar = {"friction": 2.0}


@pytest.fixture(scope="module")
def env():
    return gym.make("DexGrasp/Lift-v2", objects="gelatin_box", max_episode_steps=6, disable_env_checker=True)


SEEDS = trial_seeds(0, "gelatin_box", 0)


def run_trial(env, agent, seeds):
    return one_trial.run_trial(env, agent, seeds)[0]


def test_seeds_depend_on_seed_object_and_trial_alone():
    assert trial_seeds(3, "soda", 1) == trial_seeds(3, "soda", 1)
    assert trial_seeds(3, "/here/scan.stl", 1) == trial_seeds(3, "elsewhere/scan.stl", 1)
    seeds = {trial_seeds(s, o, k) for s in range(3) for o in ("soda", "chips", "mask") for k in range(4)}
    assert len(seeds) == 36
    assert len({t.scene for t in seeds} | {t.agent for t in seeds}) == 72


def test_seeds_are_frozen():
    """Published numbers rest on them: a change is another protocol."""
    assert trial_seeds(0, "sugar_box", 0).scene == 2272584501


def test_agents_choose_only_what_is_theirs():
    assert agent_settings("still", Still()) == {"control_mode": "joint_delta"}
    with refused("friction"):
        agent_settings("wants", Wants())


def test_agents_are_told_nothing_of_the_object(env):
    agent = Still()
    outcome = run_trial(env, agent, SEEDS)
    told = "action_space cell control_mode control_period mount obs_mode observation_space observe"
    assert sorted(agent.info) == told.split()
    assert outcome.reason == "not_touched"
    assert outcome.steps == 6
    assert outcome.planning_seconds == 0.5


def test_exceptions_of_agents_fail_the_trial_with_their_traceback(env):
    outcome = run_trial(env, Breaks(), SEEDS)
    assert outcome.reason == "agent_error: ZeroDivisionError"
    assert outcome.steps == 2
    assert "on purpose" in outcome.error
    assert "test_trials.py" in outcome.error
    assert run_trial(env, BreaksAtReset(), SEEDS).reason == "agent_error: KeyError"


@pytest.mark.parametrize("action", [None, "left", np.zeros(5), np.full(23, np.nan), [[1], [2, 3]], {"a": 1}])
def test_wrong_actions_fail_the_trial(env, action):
    agent = Gives()
    agent.action = action
    outcome = run_trial(env, agent, SEEDS)
    assert outcome.reason == "invalid_action"
    assert outcome.error


def test_agents_without_a_plan(env):
    outcome = run_trial(env, HasNoPlan(), SEEDS)
    assert (outcome.reason, outcome.steps, outcome.success) == ("no_grasp", 0, False)
    assert outcome.details["certificate"]["extra"] is None


def test_a_plan_that_failed_is_forgotten_in_the_next_trial(env):
    agent = FillsIn()
    assert [run_trial(env, agent, SEEDS).reason for _ in range(2)] == ["no_grasp", "not_touched"]
    placing = PlacingAgent(agent)
    placing.report.failure = "no_grasp"
    renew_report(placing)
    assert agent.report.failure is None


def test_duck_typed_agents_do(env):
    assert run_trial(env, Duck(), SEEDS).error is None
