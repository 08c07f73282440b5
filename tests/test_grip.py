"""A clone whose grip is corrected, as of agent `rl`: the palm moves as told."""

import gymnasium as gym
import numpy as np
from numpy.testing import assert_allclose
from refusals import refused
from robots import CELL

import dexgrasp_env  # noqa: F401
from dexgrasp.learning.reinforcement.grip_policy import GRIP_SIZE, GripPolicy
from dexgrasp.registry import make_agent
from dexgrasp.runs.policy_folder import read_policy


def grip_of(clone, correction):
    """The policy whose network always says `correction`."""
    about, arrays = read_policy(clone)
    arrays = {f"base.{name}": array for name, array in arrays.items()}
    arrays |= {"actor.0.weight": np.zeros((GRIP_SIZE, len(arrays["base.mean"]))), "actor.0.bias": correction}
    return GripPolicy({"kind": "grip", "env": about["env"], "base": about}, arrays)


def played(policy, env, steps):
    observation, _ = env.reset(seed=3)
    run, actions = policy.begin(observation, CELL), []
    for _ in range(steps):
        actions.append(run.action(observation))
        observation, *_ = env.step(actions[-1])
    return np.array(actions), observation


def test_without_a_correction_it_is_the_clone(clone):
    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box")
    plain, bent = make_agent(str(clone))._policy, grip_of(clone, np.zeros(GRIP_SIZE))
    actions = [played(policy, env, 12)[0] for policy in (plain, bent)]
    assert_allclose(*actions, atol=1e-5)
    assert np.abs(actions[0]).max() > 0.01


def test_a_correction_stays_on_top_of_the_clones_set_points(clone):
    """What is added is not added again by the clone, which would see it as its own."""
    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box")
    correction = np.zeros(GRIP_SIZE)
    correction[-1] = 0.5  # 0.2 rad at the thumb's second joint
    ends = [played(grip_of(clone, c), env, 60)[1]["joint_targets"] for c in (np.zeros(GRIP_SIZE), correction)]
    assert abs(ends[1][20] - ends[0][20] - 0.2) < 0.05


def test_what_does_not_fit_is_refused(clone):
    about, arrays = read_policy(clone)
    with refused("incomplete"):
        GripPolicy({"kind": "grip", "env": about["env"], "base": about}, arrays)
