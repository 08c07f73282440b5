"""Objects that move: how far and when, on single and vector environments, and how they are followed."""

import gymnasium as gym
import numpy as np
import pytest
from lift_envs import finished
from refusals import refused
from tables import table

from dexgrasp.agent import public_info
from dexgrasp.geometry.tracking import PlanarTracker
from dexgrasp.registry import make_agent
from dexgrasp_env.poses import quat_to_matrix
from dexgrasp_env.tasks.disturbance import MOTION, moves_now
from dexgrasp_env.tasks.records import EPISODE

MOVED, BELT = ({"kind": kind, "size": size} for kind, size in (("moved", 8.0), ("belt", 5.0)))
STILL = np.zeros(23)


def make(disturbance, **more):
    return gym.make(
        "DexGrasp/Lift-v2",
        **{"objects": "soda", "disturbance": disturbance, **more},
        disable_env_checker=True,
    )


def yaw_between(first, last):
    R = quat_to_matrix(last[3:].astype(float)) @ quat_to_matrix(first[3:].astype(float)).T
    return np.arctan2(R[1, 0], R[0, 0])


@pytest.mark.parametrize("name", ["sugar_box", "soda", "massage_ball"])
@pytest.mark.parametrize("seed", [1, 3])
def test_an_object_is_displaced_as_drawn_once_and_lies_still_before_and_after(name, seed):
    env = make(MOVED, objects=name)
    observation, info = env.reset(seed=seed)
    assert info["disturbance"] == "none"
    poses = [observation["object_pose"]] + [env.step(STILL)[0]["object_pose"] for _ in range(60)]
    motion = env.unwrapped.get_state().task_record
    starts, ends = int(motion["starts"]), int(motion["ends"])
    assert 4 <= starts <= 30
    assert ends == starts + 10
    way = 0.5 * motion["twist"]
    assert np.linalg.norm(way[:2]) <= 0.08
    assert abs(way[2]) <= np.radians(60)
    assert np.allclose(poses[starts][:3], poses[0][:3], atol=2e-4)
    assert np.allclose(poses[-1][:2] - poses[0][:2], way[:2], atol=5e-4)
    assert np.allclose(poses[-1], poses[ends + 2], atol=5e-4)
    assert abs(yaw_between(poses[0], poses[-1]) - way[2]) < 0.02


def test_a_belt_carries_steadily_towards_the_far_side():
    env = make(BELT)
    poses = np.array(
        [env.reset(seed=2)[0]["object_pose"]] + [env.step(STILL)[0]["object_pose"] for _ in range(60)]
    )
    assert np.allclose(np.diff(poses[:, 1]), -np.sign(poses[0, 1]) * 0.0025, atol=2e-5)
    assert np.allclose(poses[:, [0, 2]], poses[0, [0, 2]], atol=3e-4)


def test_what_the_hand_touches_is_displaced_no_farther_and_a_belt_goes_on():
    motions, records = np.zeros(2, MOTION), np.zeros(2, EPISODE)
    motions["ends"], motions["twist"], motions["steady"] = 9, (0.1, 0.2, 0.3), (False, True)
    records["elapsed"] = 5
    assert moves_now(motions, records)[:, :3].all()
    records["touched"] = True
    assert moves_now(motions, records).tolist() == table("moves_of_two")


def test_cameras_look_ten_times_a_second():
    env = make(BELT, obs_mode="pointcloud", observe="10hz")
    seen, new = env.reset(seed=0)[0]["cloud"], []
    for _ in range(5):
        cloud = env.step(STILL)[0]["cloud"]
        new.append(not np.array_equal(cloud, seen))
        seen = cloud
    assert new == [False, True, False, True, False]


@pytest.mark.parametrize(("name", "more"), table("moved"))
def test_where_nothing_moves_that_is_said(name, more):
    with refused("valid"):
        gym.make(f"DexGrasp/{name}", disturbance=MOVED, objects="soda", **more)


def turned(points, pose, middle):
    c, s = np.cos(pose[2]), np.sin(pose[2])
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return (points - middle) @ R.T + middle + [pose[0], pose[1], 0.0]


@pytest.mark.parametrize("jump", table("jumps"))
def test_a_tracker_finds_an_object_of_which_a_part_is_hidden(jump):
    rng = np.random.default_rng(0)
    sides = rng.uniform(-1, 1, (1500, 3))
    sides[np.arange(1500), rng.integers(0, 3, 1500)] = rng.choice([-1, 1], 1500)
    points = sides * [0.06, 0.025, 0.04] + [0.5, 0.1, 0.04]
    tracker, middle = PlanarTracker(points[:1000], 0.0), np.append(points[:1000, :2].mean(0), 0.0)
    for k in range(1, 4):
        seen = points[500:][sides[500:, 0] > -0.5]
        assert tracker.see(turned(seen, jump, middle) + rng.normal(0, 5e-4, seen.shape), 0.1 * k)
    assert np.allclose(tracker.pose, jump, atol=[3e-3, 3e-3, 0.03])
    assert not tracker.see(rng.uniform(-0.2, 0.2, (500, 3)), 1.0)
    assert not tracker.see(points[:5], 1.0)


def test_where_nothing_moves_the_tracking_planner_acts_as_the_planner():
    acts = []
    for name in ("bilevel", "bilevel_tracking"):
        agent = make_agent(name)
        env = gym.make("DexGrasp/Lift-v2", objects="soda", disable_env_checker=True, **agent.env_settings)
        observation, info = env.reset(seed=4)
        agent.seed(0)
        agent.reset(observation, public_info(env, info))
        acts.append([agent.act(observation := env.step(agent.act(observation))[0]) for _ in range(10)])
    assert np.array_equal(*acts)


@pytest.mark.slow
@pytest.mark.parametrize("disturbance", [MOVED, BELT], ids=lambda one: one["kind"])
def test_the_tracking_planner_lifts_what_moves(disturbance):
    agent = make_agent("bilevel_tracking")
    env = make(disturbance, **agent.env_settings)
    observation, info = env.reset(seed=5)
    agent.seed(0)
    agent.reset(observation, public_info(env, info))
    assert finished(env, agent, observation)["is_success"]
    assert agent.report.details["renewals"]
    assert agent.result is None
