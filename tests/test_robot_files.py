"""Robots of somebody else's MJCF: rebuilt as they are, made into files, tested; what is wrong is said in a line."""

import json
import re
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
import trimesh
import yaml
from foreign_parts import foreign_hand, six_joint_arm
from processes import typed
from refusals import refused, rejected
from robots import CELL, GRASP_FINGERS, variant

from dexgrasp.agent import public_info
from dexgrasp.evaluation.scoring.hand import find_hand
from dexgrasp.grasp.file import record_of
from dexgrasp.grasp.planned_record import Origin, planned_record
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame, reach_palm
from dexgrasp.mechanics.kinematics.robot_check import check_robot
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.planning.atlas import hand_atlas
from dexgrasp.planning.cvae_source import make_source
from dexgrasp.planning.planner import Planner, Search, small_box
from dexgrasp.planning.scene_setup import look_at
from dexgrasp.registry import make_agent
from dexgrasp_env.robot.cell import make_cell
from dexgrasp_env.robot.make import make_robot
from dexgrasp_env.robot.model import compiled_robot, posed
from dexgrasp_env.robot.robot_file import read_robot


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    out = folder / "theirs.yaml"
    assert any("velocity" in line for line in make_robot(foreign_hand(folder), None, out))
    return out


def test_a_hand_made_of_mjcf_is_where_ours_is(made):
    cell = make_cell(made)
    theirs, ours = compiled_robot(cell), compiled_robot(CELL)
    assert [theirs.joint(j).name for j in range(theirs.njnt)] == list(cell.robot.joints)
    rng, hand, mine = np.random.default_rng(0), cell.robot.hand, CELL.robot.hand
    assert hand.tip_radius == pytest.approx(0.014, abs=2e-4)
    masses = [
        model.body_subtreemass[model.body(palm).id]
        for model, palm in ((theirs, hand.palm), (ours, mine.palm))
    ]
    assert masses[0] == pytest.approx(masses[1], rel=1e-6)
    for _ in range(5):
        q = rng.uniform(CELL.robot.lower, CELL.robot.upper)
        places = []
        for model, part in ((theirs, hand), (ours, mine)):
            data = posed(model, q)
            palm = data.site(part.palm)
            R = palm.xmat.reshape(3, 3)
            places.append([
                np.r_[(data.site(f.tip).xpos - palm.xpos) @ R, (R.T @ data.site(f.tip).xmat.reshape(3, 3)).ravel()]
                for f in part.fingers
            ])  # fmt: skip
        away = np.array(places[0]) - places[1]
        assert np.ptp(away[:, :3], axis=0).max() < 5e-4  # the palm's origin lies 1 mm elsewhere
        assert np.abs(away[:, :3]).max() < 2e-3
        assert np.abs(away[:, 3:]).max() < 1e-5


def test_what_is_made_passes_its_check_grasps_and_is_scored(made, tmp_path, printed):
    cell = make_cell(made)
    assert [finding for finding in check_robot(cell) if finding.level == "error"] == []
    assert len(hand_atlas(cell).joints) > 20_000
    (idle,) = [finger for finger in cell.robot.hand.fingers if finger.aside]
    assert sorted(np.abs(idle.aside)) == pytest.approx([0.0, 0.0, 0.0, 0.4], abs=0.2)
    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box", robot=str(made))
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    agent = make_agent("bilevel")
    look = look_at("sugar_box", agent, seed=3, robot=str(made))
    plan = agent.plan(look.observation, look.info)
    content = plan.contents(look.subject.identity, "bilevel", look.subject.pose)[0]
    assert content["thresholds"]["tip_radius"] == cell.robot.hand.tip_radius
    assert rejected(record_of(content, cell=cell)) == []
    (tmp_path / "grasp.json").write_text(json.dumps(content))
    assert typed(f"score {tmp_path / 'grasp.json'} --robot {made} --json") == 0
    assert printed()["metrics_mean"]["contact_number"] > 1
    assert find_hand(str(made)).joint_names == cell.robot.hand.joints.names
    content["thresholds"]["tip_radius"] = 0.02
    assert "thresholds looser than ours" in rejected(record_of(content, cell=cell))


def test_other_grasps_of_a_hand_are_tried_in_turn(tmp_path, monkeypatch):
    others = [["thumb", "middle", "ring"], ["thumb", "index", "middle", "ring"]]
    cell = make_cell(variant(tmp_path, hand={"grasps": others}, name="several"))
    planner = Planner(cell=cell)
    assert [other.cell.robot.hand.grasp for other in planner.others()] == [tuple(names) for names in others]
    assert len({cell.stamp, *(other.cell.stamp for other in planner.others())}) == 3

    run = Search.run
    monkeypatch.setattr(Search, "run", lambda self: self.result if self.planner is planner else run(self))
    plan = planner.plan(small_box(), 0, cell.robot.home.copy())
    assert plan.grasp.fingers == tuple(others[0])
    assert plan.grasp.certificate.holds
    record = record_of(plan.as_json("box")["grasp"], cell=cell)
    assert record.check_cell().robot.hand.grasp == plan.grasp.fingers
    assert rejected(record) == []
    assert Planner().plan(small_box(), 0).grasp.fingers == GRASP_FINGERS


def test_weak_fingers_press_less_and_are_judged_by_that(tmp_path):
    cell = make_cell(variant(tmp_path, hand={"torque": 0.21}, name="weak"))
    plan = Planner(cell=cell).plan(replace(small_box(), mass=0.1), 0, cell.robot.home.copy())
    assert plan.grasp.certificate.holds
    content = plan.as_json("box")["grasp"]
    assert content["thresholds"]["least_press"] == pytest.approx(0.3 * 2.5)
    record = record_of(content, cell=cell)
    assert rejected(record) == []
    content["thresholds"]["least_press"] = 0.5
    assert "thresholds looser than ours" in rejected(record_of(content, cell=cell))


def test_an_arm_of_six_joints_bears_our_hand(tmp_path, printed):
    out = tmp_path / "six.yaml"
    assert any("arm torque: none" in note for note in make_robot(None, six_joint_arm(tmp_path), out))
    cell = make_cell(out)
    assert cell.robot.dof == 22
    assert cell.robot.hand.joints.names == CELL.robot.hand.joints.names
    assert [finding for finding in check_robot(cell) if finding.level == "error"] == []
    assert typed(f"list envs --robot {out} --json") == 0
    own = printed()["robot"]
    assert own["joints"] == list(cell.robot.joints)
    for mode, size in own["control_mode"].items():
        env = gym.make("DexGrasp/Lift-v2", objects="pear", robot=str(out), control_mode=mode)
        assert env.action_space.shape == (size,)
    tree = robot_tree(cell)
    q, turned = tree.home.copy(), np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    assert reach_palm(q, turned, np.array([0.45, 0.1, 0.25]), tree)
    np.testing.assert_allclose(palm_frame(q, tree)[1], [0.45, 0.1, 0.25], atol=2e-3)


def test_starts_of_inverse_kinematics_are_data(tmp_path):
    make_robot(None, six_joint_arm(tmp_path), tmp_path / "six.yaml")
    arm = yaml.safe_load((tmp_path / "six_arm.yaml").read_text())
    assert robot_tree(make_cell(read_robot(tmp_path / "six.yaml"))).starts.shape == (5, 6)
    starts = [arm["home"], [0.1] * 6]
    (tmp_path / "six_arm.yaml").write_text(yaml.safe_dump(arm | {"starts": starts, "plinth": 2}))
    tree = robot_tree(make_cell(read_robot(tmp_path / "six.yaml")))
    np.testing.assert_array_equal(tree.starts, starts)
    assert tree.base == 2
    (tmp_path / "six_arm.yaml").write_text(yaml.safe_dump(arm | {"starts": [[0.0]]}))
    with refused("a posture of starts has 1 numbers: valid are 6"):
        read_robot(tmp_path / "six.yaml")


def hash_and_stamp(robot, path):
    named = replace(robot, hand=replace(robot.hand, mjcf=path))
    return named.hash, named.stamp


def test_what_a_description_includes_is_part_of_its_hash(made, tmp_path):
    robot, outer, inner = make_cell(made).robot, tmp_path / "outer.xml", tmp_path / "inner.xml"
    outer.write_text('<mujoco><include file="inner.xml"/></mujoco>')
    found = []
    for inside in (
        "<mujoco/>",
        "<mujoco/>",
        '<mujoco model="other"/>',
        '<mujoco><include file="inner.xml"/></mujoco>',
    ):
        inner.write_text(inside)
        found.append(hash_and_stamp(robot, outer))
    assert found[0] == found[1]
    assert len({name for name, _ in found}) == len({stamp for _, stamp in found}) == 3


@pytest.mark.parametrize("kind", ["mjcf", "attached", "urdf"])
def test_meshes_that_a_description_names_are_part_of_its_hash(made, tmp_path, kind):
    robot, mesh = make_cell(made).robot, tmp_path / "hand" / "meshes" / "palm.stl"
    mesh.parent.mkdir(parents=True)
    inner = '<mujoco><compiler meshdir="meshes"/><asset><mesh name="palm" file="palm.stl"/></asset></mujoco>'
    inner = '<robot><mesh filename="package://hand/meshes/palm.stl"/></robot>' if kind == "urdf" else inner
    outer = tmp_path / "hand" / "inner.xml"
    outer.write_text(inner)
    if kind == "attached":
        outer = tmp_path / "outer.xml"
        outer.write_text('<mujoco><asset><model name="hand" file="hand/inner.xml"/></asset></mujoco>')
    found = []
    for side in (0.02, 0.02, 0.03):
        trimesh.creation.box((side, side, side)).export(mesh)
        found.append(hash_and_stamp(robot, outer))
    assert found[0] == found[1]
    assert all(before != after for before, after in zip(*found[1:], strict=True))


def test_policies_move_one_robot_and_weights_are_of_one_hand(made):
    with refused(r"are of the hand allegro-.* not of .*: valid are"):
        make_source("cvae", make_cell(made).robot)
    assert type(make_source("auto", make_cell(made).robot)).__name__ == "SurfaceProposals"
    env = gym.make("DexGrasp/Lift-v2", objects="pear", robot=str(made))
    observation, info = env.reset(seed=0)
    for name in ("bc", "rl"):
        agent = make_agent(name)
        agent.reset(observation, public_info(env, info))
        assert re.search("the policy moves the robot panda-.*-allegro-.*, not panda-", agent.report.failure)


FINGERS = ["thumb", "index", "middle", "ring"]


def test_four_fingers_take_hold_and_the_judge_agrees(tmp_path):
    cell = make_cell(variant(tmp_path, hand={"grasp": FINGERS}))
    planner = Planner(cell=cell, source=make_source("auto", cell.robot))
    result = planner.plan(small_box(), 0, cell.robot.home.copy())
    assert result.success, result.reason
    (planned,) = result.found
    how = {"script": planned.script, "origin": Origin("bilevel")}
    record = planned_record("box", planned.grasp, small_box(), planner.settings, **how)
    assert record.fingers == tuple(FINGERS)
    assert rejected(record) == []
    assert planned.grasp.certificate.load > 1.0
