"""Tasks of few decisions: the grasp space, held actions and features that LiftOnce and LiftStaged are made of."""

import gymnasium as gym
import numpy as np
import pytest
from lift_envs import make
from refusals import refused
from tables import table
from vector_envs import assert_same, native, singles

from dexgrasp_env.tasks.control import GRASP_SIZE

PLACE, OPENED, CLOSED = table("placing")
GRASP = np.array(PLACE + CLOSED, np.float32)


def at_height(height, hand):
    return np.array([*PLACE[:2], height, *PLACE[3:], *hand], np.float32)


def once(objects="sugar_box", **kwargs):
    return gym.make("DexGrasp/LiftOnce-v0", objects=objects, disable_env_checker=True, **kwargs)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_what_ends_within_an_action_ends_alike(mode):
    """The others' actions go on, and what comes of the ended one is told as it ended."""
    kwargs = {"env_id": "DexGrasp/LiftStaged-v0", "autoreset_mode": mode}
    ours, theirs = native(2, **kwargs), singles(2, **kwargs)
    ours.reset(seed=3)
    theirs.reset(seed=3)
    state = ours.get_state(1)
    state.physics[1 + 30 + 24] = 2.0  # time, positions, then velocities: the object's y, m/s
    theirs.envs[1].unwrapped.set_state(state)
    ours.set_state(state, [1])
    for step in range(3):
        actions = np.tile(at_height(0.3, OPENED), (2, 1))
        a, b = theirs.step(actions), ours.step(actions)
        assert_same(a, b, f"step {step}")
        assert b[2].tolist() == [False, step == 0]
    assert ours._episodes.records["elapsed"][0] == 3 * 28


def test_a_grasp_is_a_few_points_of_the_grasp_space():
    env = gym.make("DexGrasp/LiftStaged-v0", objects="sugar_box")
    env.reset(seed=1)
    looks = [
        at_height(h, hand) for h, hand in ((0.3, OPENED), (-0.86, OPENED), (-0.86, CLOSED), (1.0, CLOSED))
    ]
    total = 0.0
    for k, action in enumerate([*looks, looks[-1], looks[-1]]):
        observation, reward, terminated, truncated, info = env.step(action)
        total += reward
        if k < 2:
            np.testing.assert_allclose(observation[-GRASP_SIZE:], action, atol=0.2)
    assert (terminated, truncated, info["is_success"]) == (False, True, True)
    assert 15.0 < total <= 20.0


def test_held_actions_are_repeated_ones_and_rewards_their_sum():
    held, plain = make(hold=5, reward_scale=0.5), make()
    for env in (held, plain):
        env.reset(seed=4)
    for action in np.random.default_rng(0).uniform(-1, 1, (3, 23)):
        seen, reward, *_ = held.step(action)
        results = [plain.step(action) for _ in range(5)]
        assert all(np.array_equal(seen[key], results[-1][0][key]) for key in seen)
        assert reward == pytest.approx(0.5 * sum(result[1] for result in results), abs=1e-12)


def test_features_turn_with_the_scene_and_tell_what_the_state_does():
    env, rows = once(), []
    for angle in (0.0, 0.3):
        at, half = 0.5 * np.array([np.cos(angle), np.sin(angle)]), 0.5 * angle
        rows.append(
            env.reset(seed=0, options={"object_pose": [*at, 0.09, np.cos(half), 0.0, 0.0, np.sin(half)]})[0]
        )
    assert np.abs(rows).max() < 10.0
    changed = np.abs(rows[1] - rows[0])
    assert changed[0] == pytest.approx(1.0, abs=1e-3)  # its azimuth, in spreads of 0.3 rad
    assert changed[1:].max() < 1e-2
    friction = once(friction=0.4).reset(seed=0)[0]
    assert friction[-1] == pytest.approx(-1.5, abs=1e-6)
    staged = gym.make("DexGrasp/LiftStaged-v0", objects="sugar_box", friction=0.4).reset(seed=0)[0]
    np.testing.assert_array_equal(staged[-37:-7], friction)


# -- what earns less than any success ---------------------------------------------------------------------------


CHEATS = {
    "hover": lambda a: np.array([*a[:2], 1.0, *a[3:5], *CLOSED]),  # the hand never comes down
    "wedge": lambda a: np.array([*a[:2], -1.0, a[3], -1.0, *OPENED]),  # the fingers beside it, never closed
    "press": lambda a: np.array([1.0, 1.0, -1.0, *a[3:5], *CLOSED]),  # down at the object's corner
}


@pytest.mark.parametrize("name", CHEATS)
@pytest.mark.parametrize("task", ["LiftOnce-v0", "LiftStaged-v0", "LiftStaged-v1"])
def test_cheats_earn_less_than_any_success(name, task):
    env = gym.make(f"DexGrasp/{task}", objects="gelatin_box", disable_env_checker=True)
    env.reset(seed=0)
    total, over = 0.0, False
    while not over:
        _, reward, terminated, truncated, info = env.step(CHEATS[name](GRASP))
        total, over = total + reward, terminated or truncated
    assert not info["is_success"]
    assert total < 10.0  # what success alone is worth


def test_throwing_a_held_object_away_costs_what_holding_it_earned():
    env = gym.make("DexGrasp/LiftStaged-v0", objects="gelatin_box", disable_env_checker=True)
    env.reset(seed=0)
    total = 0.0
    for h, hand in ((0.3, OPENED), (-0.86, OPENED), (-0.86, CLOSED), (1.0, CLOSED)):
        total += env.step(at_height(h, hand))[1]
    earned = total
    _, reward, _, _, info = env.step(at_height(1.0, OPENED))  # let go at full height
    assert not info["is_success"]
    assert total + reward < earned < 10.0


# -- what is refused --------------------------------------------------------------------------------------------


def test_whole_grasps_bring_nothing_to_a_goal():
    with refused("joint_position, joint_delta, ee_delta, grasp"):
        gym.make("DexGrasp/Place-v2", control_mode="grasp_once")
