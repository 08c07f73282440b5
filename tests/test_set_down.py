"""Set down at a goal: planned in one piece, judged from the file, exported, replayed; or refused with a reason."""

import copy
import json
from functools import reduce
from operator import getitem

import gymnasium as gym
import numpy as np
import pytest
import trimesh
from processes import typed
from refusals import refused, rejected
from scipy.spatial.transform import Rotation
from tables import mistakes, table
from test_request import block

from dexgrasp import plan_cloud
from dexgrasp.agent import public_info
from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.export.replay import turned_by
from dexgrasp.geometry.hull import axes_of_symmetry
from dexgrasp.geometry.request import PLACE_WORDS, GraspRequest
from dexgrasp.grasp.file import record_of
from dexgrasp.viewer.playback import playback_of
from dexgrasp_env.arrays import middle
from dexgrasp_env.valid import check as checked

PHASES = ["approach", "lift", "carry", "set_down", "release", "retreat"]


def asked(*goal, **more):
    return plan_cloud(block(), seed=2, request=GraspRequest(goal=goal, **more))


@pytest.fixture(scope="module")
def content():
    """Return the file of a grasp that is set down a quarter turned."""
    return json.loads(json.dumps(asked(0.45, -0.25, 0.0, 90.0).contents("block")[0]))


def failing(content):
    return set(rejected(record_of(content)))


def test_the_file_has_all_phases_and_holds(content):
    assert [phase["name"] for phase in content["script"]["phases"]] == PHASES
    assert playback_of(record_of(content)).object_poses[-1, :2, 0].round(1).tolist() == [0, 1]
    assert failing(content) == set()


def test_several_that_differ_are_set_down_as_well():
    plan = asked(0.45, -0.25, 0.0, count=2)
    assert len(plan.found) == 2
    assert all("retreat" in one.script.phases for one in plan.found)


def test_the_judge_refuses_another_goal_and_a_changed_way(content):
    for path, by, check in table("changes_of_placing"):
        other = copy.deepcopy(content)
        *way, last = path
        reduce(getitem, way, other)[last] += by
        found = failing(other)
        assert found == {check} if "goal" in path else check in found, path
    with refused("with a goal alone"):
        record_of(content | {"request": None})


@pytest.mark.parametrize(("goal", "reason"), mistakes("goals"))
def test_a_goal_that_cannot_be_is_refused_with_its_reason(goal, reason):
    plan = asked(*goal)
    assert plan.reason == f"no_grasp:{reason}"
    assert plan.log.tried == 0  # no posture is refined for it


def test_what_stands_there_is_not_set_upon():
    rng = np.random.default_rng(1)
    other = rng.uniform(size=(3000, 3))
    other[np.arange(3000), rng.integers(0, 3, 3000)] = rng.integers(0, 2, 3000)
    points = np.concatenate([block(), [0.43, -0.27, 0.0] + other * 0.06])
    goals = [(0.46, -0.24, 0.0), (0.6, -0.2, 0.0)]
    near = (0.52, 0.02, 0.04)
    plans = [plan_cloud(points, near=near, seed=2, request=GraspRequest(goal=goal)) for goal in goals]
    assert [plan.reason for plan in plans] == ["no_grasp:goal_occupied", None]
    (content,) = plans[1].contents("block")
    assert failing(json.loads(json.dumps(content))) == set()


def test_the_agent_sets_the_object_down():
    agent = BilevelAgent(request=GraspRequest(goal=(0.4, -0.25, 0.0)))
    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box", disable_env_checker=True, **agent.env_settings)
    observation, info = env.reset(seed=2)
    agent.reset(observation, public_info(env, info))
    target = agent.result.target
    shift = np.array([0.4, -0.25]) - middle(target.corners)[:2]
    before = env.unwrapped.simulation.object_pose()
    for _ in range(240):
        observation, *_, info = env.step(agent.act(observation))
    assert not info["is_grasped"]
    after = env.unwrapped.simulation.object_pose()
    assert np.linalg.norm((after - before)[:2] - shift) < 0.02
    assert abs(after[2] - before[2]) < 0.005  # it stands as it lay


def test_turns_that_nobody_sees_do_not_count():
    can, ball, box = (
        trimesh.creation.cylinder(0.03, 0.1),
        trimesh.creation.icosphere(3, 0.04),
        trimesh.creation.box((0.05, 0.05, 0.1)),
    )
    axes = [axes_of_symmetry(np.array(mesh.vertices)) for mesh in (can, ball, box)]
    assert [len(found) for found in axes] == [1, 3, 0]
    lying = Rotation.from_euler("y", 90, degrees=True)
    rolled, turned, tipped = (Rotation.from_euler(axis, 30, degrees=True) * lying for axis in ("x", "z", "y"))
    for now, seen, leaning in ((rolled, 0.0, 0.0), (turned, 30.0, 0.0), (tipped, 30.0, 30.0)):
        poses = now.as_matrix(), lying.as_matrix()
        for any_heading, wanted in ((False, seen), (True, leaning)):
            assert np.degrees(turned_by(*poses, axes[0], any_heading)) == pytest.approx(wanted, abs=0.6)
        assert np.degrees(turned_by(*poses, axes[2], False)) == pytest.approx(30.0, abs=0.1)
        assert turned_by(*poses, axes[1], False) == 0.0


def test_the_command_exports_and_replays_it(tmp_path, capsys):
    grasp = tmp_path / "grasp"
    assert typed(f"plan sugar_box --seed 1 --out {grasp} --place 0.45 -0.2 0") == 0
    assert typed(f"verify {grasp / 'grasp.json'}") == 0
    for kind in ("mjcf", "json", "ros2"):
        assert typed(f"export {grasp / 'grasp.json'} --format {kind} --out {tmp_path / kind}") == 0
    capsys.readouterr()
    assert typed(f"check {tmp_path / 'json'}") == 0
    assert typed(f"check {tmp_path / 'mjcf'} --replay 2 --need 1/2") == 0
    assert "set down at its goal, nothing else touched" in capsys.readouterr().out
    with refused("place is"):
        checked("place", (1, 2, 3, 4, 5), PLACE_WORDS)
