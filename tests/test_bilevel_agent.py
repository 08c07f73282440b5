"""The agent `bilevel` in its environment: plans, reasons, execution with feeling, nothing of torch."""

import json
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from processes import python
from refusals import refused
from robots import CELL, LOWER, ROBOT, UPPER, denormalise

from dexgrasp import make_agent
from dexgrasp.agent import public_info
from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.evaluation.protocol import TrialSeeds
from dexgrasp.evaluation.trial import run_trial
from dexgrasp.mechanics.kinematics.forward import fingertips
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.motion.move_until_contact import GuardedGrasp
from dexgrasp.planning.plan_scene import plan_scene
from dexgrasp.planning.scene_setup import look_at

COLUMNS = (np.r_[19:23], np.r_[7:11], np.r_[11:15])  # thumb, index, middle


@pytest.fixture(scope="module")
def attempt():
    """An agent that has planned, and what it looked at."""
    agent = BilevelAgent(proposals="surface")
    look = look_at("sugar_box", agent, seed=0)
    agent.reset(look.observation, {})
    yield SimpleNamespace(agent=agent, **look._asdict())
    look.env.close()


@pytest.fixture(scope="module")
def agent():
    return make_agent("bilevel")


def tips(q):
    return fingertips(q, robot_tree(CELL))


def test_reports_a_plan(attempt):
    report = attempt.agent.report
    assert report.failure is None
    assert 0 < report.planning_seconds < 20
    assert set(report.details["stages"]) >= {
        "hull",
        "proposals",
        "postures",
        "bilevel",
        "certificate",
        "approach",
    }
    assert sum(report.details["stages"].values()) <= report.planning_seconds + 1e-3
    assert report.details["certificate"]["holds"] is True
    json.dumps(report.details, allow_nan=False)


def test_plans_on_what_was_seen_not_on_the_truth(attempt):
    """The hull is the cloud's: near the true box, but not it; nothing of pose or mass is in the public info."""
    true = attempt.env.unwrapped.simulation.object.mesh.copy()
    true.apply_transform(attempt.subject.pose.T_world_object)
    target = attempt.agent.result.target
    seen = target.hull.vertices
    assert_allclose(seen.min(0), true.bounds[0], atol=0.02)
    assert_allclose(seen.max(0), true.bounds[1], atol=0.02)
    assert target.mass != attempt.env.unwrapped.simulation.object.mass
    info = public_info(attempt.env, {"object_height": 1.0, "perception_failure": None})
    assert "object_height" not in info


def test_lifts_the_sugar_box(attempt):
    """One whole episode; also: the same observation gives the same plan, and every action is in the space."""
    env, first = attempt.env, attempt.agent.result.grasp
    attempt.agent.reset(attempt.observation, {})
    assert_array_equal(attempt.agent.result.grasp.q, first.q)
    observation, steps = attempt.observation, 0
    while True:
        action = attempt.agent.act(observation)
        assert env.action_space.contains(action)
        observation, _, terminated, truncated, info = env.step(action)
        steps += 1
        if terminated or truncated or info["is_success"]:
            break
    assert info["is_success"]
    assert info["object_height"] > 0.1
    assert info["object_slip"] < 0.02


def test_grasps_again_what_was_lost():
    """The object is taken out of the hand and put elsewhere: the agent goes home, looks, and lifts it after all."""
    agent = BilevelAgent()
    env = gym.make("DexGrasp/Lift-v2", objects="gelatin_box", max_episode_steps=400, **agent.env_settings)
    observation, info = env.reset(seed=1)
    agent.seed(1)
    agent.reset(observation, public_info(env, info))
    qpos, taken, over = env.unwrapped.data.qpos, False, False
    place = qpos[23:] - [0.1, 0, 0, 0, 0, 0, 0]
    while not over:
        observation, _, terminated, truncated, info = env.step(agent.act(observation))
        if not taken and info["object_height"] > 0.03:
            qpos[23:], env.unwrapped.data.qvel[23:], taken = place, 0.0, True
        over = terminated or truncated or info["is_success"]
    assert taken
    assert agent.report.details["regrasps"] == 1
    assert info["is_success"]


@pytest.mark.parametrize(("blind", "reason", "steps"), [(1, None, 100), (9, "no_grasp:closure_margin", 7)])
def test_looks_again_where_there_is_no_grasp(blind, reason, steps, monkeypatch):
    """The first `blind` plans find no grasp."""
    plans = []

    def blinded(*arguments, **options):
        plans.append(plan_scene(*arguments, **options))
        if len(plans) <= blind:
            plans[-1].found, plans[-1].shortfall = [], "closure_margin"
        return plans[-1]

    for module in ("bilevel", "stages"):
        monkeypatch.setattr(f"dexgrasp.agents.{module}.plan_scene", blinded)
    agent = BilevelAgent()
    env = gym.make("DexGrasp/Lift-v2", objects="gelatin_box", **agent.env_settings)
    outcome, grasp = run_trial(env, agent, TrialSeeds(1, 1))
    assert outcome.reason == reason
    assert outcome.success == (reason is None) == (grasp is not None)
    assert outcome.steps >= steps
    assert outcome.steps < 300
    assert outcome.details["regrasps"] == min(blind, 2)
    assert outcome.planning_seconds >= sum(plan.log.seconds["bilevel"] for plan in plans[: blind + 1])


def failures():
    few = {"cloud_mask": np.r_[np.ones(3, np.int8), np.zeros(1021, np.int8)]}
    flat = np.random.default_rng(0).uniform([0.4, -0.1, 0.05], [0.6, 0.1, 0.05], (1024, 3)).astype(np.float32)
    seen = {"cloud": flat, "cloud_mask": np.ones(1024, np.int8)}
    return [
        (few, {}, "empty_cloud"),
        (seen | {"table_plane": np.zeros(6, np.float32)}, {}, "cloud_has_no_volume"),
        (seen, {"perception_failure": "no_object_points"}, "no_object_points"),
    ]


@pytest.mark.parametrize(("change", "info", "reason"), failures())
def test_says_why_there_is_no_plan(change, info, reason, attempt, agent):
    agent.reset({**attempt.observation, **change}, info)
    assert agent.report.failure == reason
    assert not agent.result.found
    with refused("no plan"):
        agent.act(attempt.observation)


def test_the_mount_follows_the_environment(attempt, agent):
    agent.reset(attempt.observation, {"mount": "fingers_along"})
    assert agent.result.grasp is None or agent.result.grasp.cell.robot.mount.name == "fingers_along"
    agent.reset(attempt.observation, {"mount": "palm_normal"})
    assert agent.result.grasp.cell.robot.mount.name == "palm_normal"


# Guarded execution


def closing(attempt, blocked):
    """Play the approach and the close with joints that follow at once, but each finger stops at a share of its way.

    Returns the set-points of the close, and the shares at which the fingers end.
    """
    grasp, script = attempt.agent.result.grasp, attempt.agent.result.script
    execution = GuardedGrasp(script, grasp)
    start, end = script.phases["approach"][-1], script.phases["close"][-1]
    q, targets = start.copy(), []
    for _ in script.phases["approach"]:
        assert_allclose(denormalise(execution.action(q), ROBOT), script.targets[len(targets)], atol=1e-5)
        targets.append(0)
    closed = []
    while not execution.done:
        target = denormalise(execution.action(q), ROBOT)
        closed.append(target)
        q = target.copy()
        for finger, columns in enumerate(COLUMNS):
            way = end[columns] - start[columns]
            share = (target[columns] - start[columns]) @ way / (way @ way)
            if share > blocked[finger]:
                q[columns] = start[columns] + blocked[finger] * way
    return start, end, np.array(closed), execution


def shares(start, end, targets):
    out = []
    for columns in COLUMNS:
        way = end[columns] - start[columns]
        out.append((targets[:, columns] - start[columns]) @ way / (way @ way))
    return np.array(out).T


def test_each_finger_stops_where_it_meets_something(attempt):
    blocked = (0.6, 0.9, 1.2)
    start, end, targets, _ = closing(attempt, blocked)
    travel = np.linalg.norm(tips(end) - tips(start), axis=1)
    moving = shares(start, end, targets)
    # Before the squeeze starts the set-point is past the contact by the lag that tells it, and a step or two.
    ends = [np.flatnonzero(np.abs(np.diff(moving[:, f])) < 1e-9)[0] for f in range(3)]
    for finger in range(3):
        reached = moving[ends[finger], finger]
        assert blocked[finger] < reached < blocked[finger] + 0.008 / travel[finger]
    assert ends[0] < ends[2]


def test_a_finger_that_meets_nothing_stops_soon_after_the_surface(attempt):
    start, end, targets, _ = closing(attempt, (9.0, 9.0, 9.0))
    travel = np.linalg.norm(tips(end) - tips(start), axis=1)
    moving = shares(start, end, targets)
    stop = np.flatnonzero((np.abs(np.diff(moving, axis=0)) < 1e-9).all(1))[0]
    assert stop < 60
    assert (moving[stop] > 1.0).all()
    assert (moving[stop] < 1.0 + 0.0161 / travel).all()  # or less, where a joint's range ends


def test_the_squeeze_presses_from_where_the_joints_stand(attempt):
    """A servo at rest bears the planned force at its contact; what the links weigh is compensated beside it."""
    import mujoco

    from dexgrasp_env.robot.model import robot_spec

    start, end, targets, _ = closing(attempt, (0.6, 0.9, 1.1))
    grasp = attempt.agent.result.grasp
    stand = targets[-1].copy()
    for finger, columns in enumerate(COLUMNS):
        stand[columns] = start[columns] + (0.6, 0.9, 1.1)[finger] * (end - start)[columns]
    model = robot_spec(CELL).compile()
    data, J = mujoco.MjData(model), np.zeros((3, model.nv))
    data.qpos[:23] = stand
    mujoco.mj_forward(model, data)
    torque = (data.qfrc_bias - data.qfrc_gravcomp)[:23]
    assert np.abs(data.qfrc_bias[7:23]).max() > 0.02  # or compensation would not matter
    for finger, normal, force in zip(("thumb", "index", "middle"), grasp.normals, grasp.forces, strict=True):
        site = model.site(f"{finger}_tip").id
        mujoco.mj_jac(model, data, J, None, data.site_xpos[site] - 0.0105 * normal, model.site_bodyid[site])
        torque += (J.T @ force)[:23]
    for columns in COLUMNS:
        pressed = stand[columns] + np.clip(torque[columns], -0.7, 0.7) / 10.0
        assert_allclose(targets[-1][columns], np.clip(pressed, LOWER[columns], UPPER[columns]), atol=2e-4)


def test_works_without_torch_and_the_same_in_another_process(attempt):
    code = """
        import sys

        class Absent:
            def find_spec(self, name, path=None, target=None):
                if name.split(".")[0] in ("torch", "h5py", "stable_baselines3"):
                    raise ModuleNotFoundError(f"No module named {name!r}", name=name)

        sys.meta_path.insert(0, Absent())
        from dexgrasp.planning.scene_setup import look_at
        from dexgrasp.agents.bilevel import BilevelAgent
        agent = BilevelAgent()
        look = look_at("sugar_box", agent, seed=0)
        agent.reset(look.observation, {})
        assert agent.report.failure is None, agent.report
        agent.act(look.observation)
        agent = BilevelAgent(proposals="surface")
        agent.reset(look.observation, {})
        print(agent.result.grasp.q.tobytes().hex())
    """
    assert python(code).split()[-1] == attempt.agent.result.grasp.q.tobytes().hex()
