"""A clone's grip corrected by reinforcement: begins at the clone, moves the palm as told, resumes to the same bits."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose
from refusals import refused
from robots import CELL, HOME
from trainings import begun, goes_on_to_the_same_bits

from dexgrasp.learning.reinforcement.grip_policy import GRIP_SIZE, GripPolicy, arm_step, first_features
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.registry import make_agent
from dexgrasp.runs.policy_folder import read_policy, write_policy

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
import gymnasium as gym  # noqa: E402

import dexgrasp_env  # noqa: E402, F401
from dexgrasp.learning.reinforcement.rl_tasks import GripTask  # noqa: E402
from dexgrasp.learning.reinforcement.rollout_training import RolloutTraining  # noqa: E402
from dexgrasp.learning.reinforcement.settings import GripSettings  # noqa: E402

SETTINGS = GripSettings(
    ("sugar_box",), episode_steps=12, episodes=12, num_envs=2, round_episodes=2, group_size=2, net_arch=(8, 8)
)


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


@pytest.mark.parametrize("axis", range(6))
def test_the_palm_moves_along_and_about_its_own_axes(axis):
    tree, move = robot_tree(CELL.mounted("palm_normal")), np.zeros(6)
    move[axis] = 0.005 if axis < 3 else 0.04
    R, p = palm_frame(HOME, tree)
    q = HOME.copy()
    q[:7] += arm_step(HOME, move, tree)
    turned, shifted = palm_frame(q, tree)
    assert_allclose(R.T @ (shifted - p), move[:3], atol=4e-4)
    spin = R.T @ turned
    found = 0.5 * np.array([spin[2, 1] - spin[1, 2], spin[0, 2] - spin[2, 0], spin[1, 0] - spin[0, 1]])
    assert_allclose(found, move[3:], atol=3e-3)


def test_a_correction_stays_on_top_of_the_clones_set_points(clone):
    """What is added is not added again by the clone, which would see it as its own."""
    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box")
    correction = np.zeros(GRIP_SIZE)
    correction[-1] = 0.5  # 0.2 rad at the thumb's second joint
    ends = [played(grip_of(clone, c), env, 60)[1]["joint_targets"] for c in (np.zeros(GRIP_SIZE), correction)]
    assert abs(ends[1][20] - ends[0][20] - 0.2) < 0.05


def test_training_goes_on_to_the_same_bits_and_gives_an_agent(tmp_path, clone):
    assert goes_on_to_the_same_bits(RolloutTraining, partial(GripTask, SETTINGS, clone), tmp_path).epoch == 3
    work = RolloutTraining(GripTask(SETTINGS, clone), tmp_path / "whole")
    work.begin()
    work.envs.seed(5)
    meant, _ = work.model.predict(work.envs.reset()[:1], deterministic=True)
    work.envs.close()
    agent, observation = begun(tmp_path / "whole", 8)
    grip = agent._policy
    looks = first_features(grip.clone, observation)
    assert np.abs(grip.correction(looks)).max() > 0.0  # it has learned something
    assert meant.shape == (1, GRIP_SIZE)


def test_groups_of_one_have_nothing_to_be_above_of():
    with refused("group_size is 1: valid is 2 or more"):
        replace(SETTINGS, group_size=1)


def test_what_does_not_fit_is_refused(tmp_path, clone):
    about, arrays = read_policy(clone)
    with refused("incomplete"):
        GripPolicy({"kind": "grip", "env": about["env"], "base": about}, arrays)
    write_policy(clone, about | {"env": {"obs_mode": "state", "control_mode": "joint_position"}}, arrays)
    with refused("clone another"):
        GripTask(SETTINGS, clone)
