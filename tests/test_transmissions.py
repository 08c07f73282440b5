"""Joints that drive others, a gripper's slides or a tendon's: made, simulated, planned with, pushed, verified."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose
from refusals import refused, rejected
from robots import variant
from tables import mistakes

from dexgrasp.evaluation.evaluate import evaluate
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.evaluation.store import read_rows
from dexgrasp.export.grasp_export import grasp_facts
from dexgrasp.grasp.file import read_grasp
from dexgrasp.grasp.verify.scene import Scene
from dexgrasp.grasp.verify.verify import verify
from dexgrasp.mechanics.kinematics.forward import fingertips, follow, hand_contact_jacobian, stop_torques
from dexgrasp.mechanics.kinematics.robot_check import check_robot
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp_env.objects.load import load_object
from dexgrasp_env.robot.cell import make_cell
from dexgrasp_env.robot.make import make_robot
from dexgrasp_env.robot.model import compiled_robot
from dexgrasp_env.robot.robot_file import read_robot
from dexgrasp_env.scene.build import build_scene
from dexgrasp_env.tasks.randomisation import Variation, apply_variation

CELL = make_cell("panda_gripper")
TREE = robot_tree(CELL)


def test_jacobians_are_those_of_what_drives():
    """Both jaws move with the first slide, which has the torque and the stiffness of both."""
    assert [finding for finding in check_robot(CELL) if finding.level != "info"] == []
    q, normals = CELL.robot.home.copy(), np.array([[0.6, 0.8, 0.0], [0.0, -1.0, 0.0]])
    tips = fingertips(q, TREE)
    ours = hand_contact_jacobian(q, tips, normals, TREE)
    scene = Scene(CELL, [], ("left", "right"))
    scene.place(q)
    assert_allclose(ours, scene.jacobians(tips, normals), atol=1e-12)
    gap = [
        np.linalg.norm(np.diff(fingertips(q - [0, 0, 0, 0, 0, 0, 0, by, by], TREE), axis=0))
        for by in (0.0, 0.01)
    ]
    assert gap[0] - gap[1] == pytest.approx(0.02)
    assert np.array_equal(ours[:, :, 1], np.zeros((2, 4)))
    assert (TREE.torque[0], TREE.stiffness[0]) == (120.0, 12000.0)


def test_soft_tips_turn_against_friction():
    """Their pairs have condim 4, with torsional friction that follows the sliding one."""
    base = build_scene(load_object("sugar_box"), CELL)
    model = build_scene(load_object("sugar_box"), CELL)
    apply_variation(model, base, Variation(friction=0.35), mujoco.MjData(model))
    for built, friction in ((base, 0.7), (model, 0.35)):
        tips = [k for k in range(built.npair) if "tip" in built.pair(k).name]
        assert len(tips) == 2
        assert set(built.pair_dim[tips]) == {4}
        assert_allclose(built.pair_friction[tips, :3], [[friction, friction, 0.008 * friction]] * 2)
    coupling = base.equality("right_slide")
    assert base.eq_type[coupling.id] == mujoco.mjtEq.mjEQ_JOINT


def lifted(settings, folder, cell):
    """Evaluate on one scene, in which the object is lifted; return the grasp."""
    evaluate(settings, folder)
    (row,) = read_rows(folder)
    assert row["success"], row["reason"]
    return read_grasp(folder / row["grasp"], cell)


def test_it_lifts_what_is_pushed_and_the_judge_agrees(tmp_path):
    settings = EvaluationSettings.of(
        ["bilevel"], ["glasses_case"], trials=1, seed=1000, robot="panda_gripper", protocols=["pushed@1"]
    )
    record = lifted(settings, tmp_path, CELL)
    assert rejected(record) == []
    assert record.forces.shape == (2, 4)
    squeeze = grasp_facts(record, CELL, 6000.0)["squeeze"]
    assert squeeze["offset"] == pytest.approx((record.squeeze - record.grasp)[7:], abs=1e-6)
    apart = record.grasp.copy()
    apart[-1] += 0.002
    object.__setattr__(record, "grasp", apart)
    failed = rejected(record)
    assert "coupled joints as stated" in failed


@pytest.mark.parametrize(("change", "words"), mistakes("grippers"))
def test_what_no_gripper_is_ends_in_a_line(change, words, tmp_path):
    with refused(words):
        read_robot(variant(tmp_path, "panda_gripper", hand=change))


_FINGER = """
<body name="{n}_base" pos="{at}" {turned}>
  <joint name="{n}_spread" class="spread"/><geom fromto="0 0 0 0 0 0.02"/>
  <body name="{n}_near" pos="0 0 0.02">
    <joint name="{n}_flex"/><geom fromto="0 0 0 0 0 0.045"/>
    <body name="{n}_middle" pos="0 0 0.045">
      <joint name="{n}_bend"/><geom fromto="0 0 0 0 0 0.025"/>
      <body name="{n}_far" pos="0 0 0.025"><joint name="{n}_curl"/><geom fromto="0 0 0 0 0 0.03"/></body>
    </body>
  </body>
</body>"""
_HAND = """
<mujoco model="pulled">
  <compiler angle="radian"/>
  <default>
    <joint axis="0 1 0" range="0 1.6" actuatorfrcrange="-1 1" damping="0.02"/>
    <geom type="capsule" size="0.01" mass="0.03"/>
    <position kp="1" forcerange="-1 1"/>
    <default class="spread"><joint axis="1 0 0" range="-0.5 0.5"/></default>
  </default>
  <worldbody>
    <body name="forearm">
      <geom type="box" size="0.01 0.03 0.03" pos="0 0 -0.14" mass="0.2"/>
      <body name="plate">
        <joint name="wrist" range="-0.5 0.5"/>
        <geom type="box" size="0.012 0.045 0.05" pos="0 0 -0.05" mass="0.4"/>{left}{right}{thumb}
      </body>
    </body>
  </worldbody>
  <tendon>{tendons}</tendon>
  <actuator>{servos}</actuator>
</mujoco>"""
_PULLED = '<fixed name="{n}"><joint joint="{n}_bend" coef="1.6"/><joint joint="{n}_curl" coef="2"/></fixed>'
_SERVO = '<position name="{n}" tendon="{n}"/>'


def _mjcf(servos: str = _SERVO) -> str:
    thumb = _FINGER.format(n="thumb", at="0.01 0 -0.08", turned='xyaxes="0 0 1 0 -1 0"')
    for name in ("bend", "flex"):
        thumb = thumb.replace(f'name="thumb_{name}"', f'name="thumb_{name}" range="-0.8 1.2"')
    fingers = {
        n: _FINGER.format(n=n, at=f"0 {y} 0", turned="") for n, y in (("left", 0.03), ("right", -0.03))
    }
    tendons, pulling = ("".join(text.format(n=n) for n in fingers) for text in (_PULLED, servos))
    return _HAND.format(**fingers, thumb=thumb, tendons=tendons, servos=pulling)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pulled")
    (folder / "hand.xml").write_text(_mjcf())
    notes = make_robot(folder / "hand.xml", None, folder / "pulled.yaml")
    assert any("wrist" in note for note in notes)
    return folder / "pulled.yaml"


def test_what_is_made_is_right(made):
    cell = make_cell(made)
    hand = cell.robot.hand
    assert [(tendon.joints, tendon.coefs) for tendon in hand.tendons] == [
        ((f"{n}_bend", f"{n}_curl"), (0.8, 1.0)) for n in ("left", "right")
    ]
    assert hand.held == ("wrist",)
    assert_allclose(cell.robot.freed(cell.robot.home), cell.robot.home, atol=2e-4)
    assert [finding for finding in check_robot(cell) if finding.level != "info"] == []


def test_a_tendon_turns_its_joints_from_their_stops_together(made):
    """Whatever joints it is told, the servo feels and moves the tendon: the simulation ends where `freed` says."""
    robot, model = make_cell(made).robot, compiled_robot(make_cell(made))
    tied = [robot.joints.index(f"left_{name}") for name in ("bend", "curl")]
    for places in ((0.5, 0.1), (0.0, 0.5)):
        data = mujoco.MjData(model)
        data.qpos[:] = robot.home
        data.qpos[tied] = 0.0
        told = data.qpos.copy()
        told[tied] = places
        data.ctrl[:] = data.qpos
        for share in np.linspace(0.0, 1.0, 1000):
            data.ctrl[tied] = share * told[tied]
            mujoco.mj_step(model, data)
        expected = robot.freed(told)
        assert expected[tied] @ (0.8, 1.0) == pytest.approx(np.dot(places, (0.8, 1.0)))
        assert_allclose(data.qpos[tied], expected[tied], atol=0.02)


def test_on_an_object_the_stop_bears_what_the_tendon_cannot(made):
    cell = make_cell(made)
    tree, robot = robot_tree(cell), cell.robot
    q = robot.home.copy()
    free = q.copy()
    follow(q, tree)
    assert_allclose(robot.drive[0] @ q + robot.drive[1], q, atol=1e-12)
    assert_allclose(robot.freed(q), robot.freed(free), atol=1e-12)
    scene = Scene(cell, [], robot.hand.grasp)
    scene.place(q)
    tips = np.array([scene.data.site(finger.tip).xpos for finger in robot.grasping])
    normals = np.tile([0.0, 0.0, 1.0], (3, 1))
    ours = hand_contact_jacobian(q, tips, normals, tree)
    assert_allclose(ours, scene.jacobians(tips, normals), atol=1e-12)
    assert not ours[:, :, tree.stands[tree.arm :]].any()
    forces = np.random.default_rng(0).normal(size=(3, 3))
    torque = np.einsum("frj,fr->j", scene.jacobians(tips, normals, driven=False), forces)
    own = dict(zip(robot.hand.joints.names, torque, strict=True))
    left = [own[f"{n}_bend"] - 0.8 * own[f"{n}_curl"] for n in ("left", "right")]
    assert_allclose(stop_torques(q, tips, normals, forces, tree), left, atol=1e-12)


def test_it_lifts_and_the_judge_agrees(made, tmp_path):
    settings = EvaluationSettings.of(["bilevel"], ["pear"], trials=1, seed=1000, robot=str(made))
    record = lifted(settings, tmp_path, make_cell(made))
    checks = verify(record)
    assert [check for check in checks if not check.holds] == []
    assert "torque on the stops of tendons" in [check.name for check in checks]
    pulled = tuple(replace(contact, force=-np.array(contact.force)) for contact in record.contacts)
    object.__setattr__(record, "contacts", pulled)
    failed = rejected(record)
    assert "torque on the stops of tendons" in failed
    apart = record.grasp.copy()
    apart[make_cell(made).robot.joints.index("left_bend")] += 0.002
    object.__setattr__(record, "grasp", apart)
    assert "coupled joints as stated" in rejected(record)


@pytest.mark.parametrize("servos", ["", _SERVO.replace('tendon="{n}"', 'joint="{n}_curl"')])
def test_tendons_that_nothing_pulls_are_left_out_and_noted(servos, tmp_path):
    (tmp_path / "hand.xml").write_text(_mjcf(servos))
    notes = make_robot(tmp_path / "hand.xml", None, tmp_path / "x.yaml")
    assert any("tendons over pulleys or without servos are left out" in note for note in notes)
