"""Grippers as makers describe them, sliding or on closed loops: read, checked, carried out by what takes any hand."""

import gymnasium as gym
import numpy as np
import pytest
import yaml
from lift_envs import finished
from numpy.testing import assert_allclose

import dexgrasp_env  # noqa: F401  (registers the ids)
from dexgrasp.agents.hardcoded import HardcodedAgent
from dexgrasp.mechanics.kinematics.robot_check import check_robot
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp_env.robot.cell import make_cell
from dexgrasp_env.robot.make import make_robot
from dexgrasp_env.robot.model import compiled_robot, posed

_JAW = """
<body name="{n}" pos="0 0 0.05" {turned}><joint name="{n}_slide" type="slide" axis="0 1 0" range="0 0.045"/>
  <geom type="box" size="0.01 0.004 0.02" pos="0 0.012 0.02" mass="0.02"/>
  <geom type="box" size="0.009 0.003 0.009" pos="0 0.005 0.035" mass="0.01"/></body>"""
SLIDES = f"""
<mujoco model="slides"><compiler angle="radian"/><worldbody>
  <body name="case"><geom type="box" size="0.02 0.07 0.03" pos="0 0 0.02" mass="0.5"/>
    {_JAW.format(n="one", turned="")}{_JAW.format(n="two", turned='quat="0 0 0 1"')}</body>
</worldbody>
<tendon><fixed name="both"><joint joint="one_slide" coef="0.5"/><joint joint="two_slide" coef="0.5"/></fixed></tendon>
<equality><joint joint1="one_slide" joint2="two_slide"/></equality>
<actuator><general name="close" tendon="both" forcerange="-80 80" ctrlrange="0 255" gainprm="0.02"
  biastype="affine" biasprm="0 -100 -10"/></actuator></mujoco>"""
_SIDE = """
<body name="{n}_crank" pos="0 {far} 0.05" {turned}><joint name="{n}_crank" axis="1 0 0" range="0 0.8"/>
  <geom type="capsule" size="0.004" fromto="0 0 0 0 0.03 0.03" mass="0.02"/></body>
<body name="{n}_bar" pos="0 {near} 0.065" {turned}><joint name="{n}_bar" axis="1 0 0" range="-0.5 1"/>
  <geom type="capsule" size="0.004" fromto="0 0 0 0 0.03 0.03" mass="0.02"/>
  <body name="{n}_jaw" pos="0 0.03 0.03"><joint name="{n}_jaw" axis="1 0 0" range="-1 1"/>
    <geom type="box" size="0.01 0.004 0.025" pos="0 0 0.03" mass="0.02"/></body></body>"""
LOOPS = f"""
<mujoco model="loops"><compiler angle="radian"/><default><geom contype="1"/></default><worldbody>
  <body name="case"><geom type="box" size="0.02 0.05 0.02" pos="0 0 0.02" mass="0.5"/>
    {_SIDE.format(n="l", near=0.018, far=0.03, turned="")}
    {_SIDE.format(n="r", near=-0.018, far=-0.03, turned='quat="0 0 0 1"')}</body>
</worldbody>
<equality><connect body1="l_crank" body2="l_jaw" anchor="0 0.03 0.03"/>
  <connect body1="r_crank" body2="r_jaw" anchor="0 0.03 0.03"/>
  <joint joint1="r_crank" joint2="l_crank"/></equality>
<actuator><position name="close" joint="l_crank" kp="50" forcerange="-4 4"/></actuator></mujoco>"""


def made(folder, text):
    """Return the notes, the hand's file and the cell of a gripper's MJCF."""
    (folder / "theirs.xml").write_text(text)
    notes = make_robot(folder / "theirs.xml", None, folder / "mine.yaml")
    return notes, yaml.safe_load((folder / "mine_hand.yaml").read_text()), make_cell(folder / "mine.yaml")


def gap(cell, q):
    """Return the vector between the tips, m, at joints (n,)."""
    data = posed(compiled_robot(cell), q)
    return data.site("left_tip").xpos - data.site("right_tip").xpos


def test_sliding_jaws_are_one_drive_of_the_force_that_its_tendon_states(tmp_path):
    _, hand, cell = made(tmp_path, SLIDES)
    assert hand["grasp"] == ["left", "right"]
    assert [(own["joint"], own["follows"], own["ratio"]) for own in hand["couplings"]] == [
        ("one_slide", "two_slide", 1.0)
    ]
    assert robot_tree(cell).torque[1] == pytest.approx(80.0)
    q, open_gap = cell.robot.home.copy(), np.linalg.norm(gap(cell, cell.robot.home))
    q[-2:] -= 0.01
    assert open_gap - np.linalg.norm(gap(cell, q)) == pytest.approx(0.02)
    # The pads are 2 mm apart when closed: each stands 2 mm out of the middle.
    closed = np.r_[q[:-2], 0.0, 0.0]
    assert np.linalg.norm(gap(cell, closed)) == pytest.approx(0.004 + 2 * hand["tip_radius"], abs=1e-6)


@pytest.mark.parametrize("text", [SLIDES, LOOPS])
def test_nothing_is_wrong_with_what_is_made_of_a_gripper(text, tmp_path):
    _, _, cell = made(tmp_path, text)
    assert [finding for finding in check_robot(cell) if finding.level == "error"] == []


def test_loops_are_reduced_to_their_drive(tmp_path):
    """Cranks and bars are equally long: bars turn as their cranks do, and jaws keep upright."""
    notes, hand, cell = made(tmp_path, LOOPS)
    leads = {own["joint"]: (own["follows"], own["ratio"]) for own in hand["couplings"]}
    (leader,) = {follows for follows, _ in leads.values()}
    assert leader.endswith("_bar")
    ratios = {joint: ratio for joint, (_, ratio) in leads.items()}
    assert_allclose([ratios[n] for n in ("l_crank", "r_crank", "l_jaw", "r_jaw")], [1, 1, -1, -1], atol=0.01)
    assert any("loops are reduced" in note for note in notes)
    assert robot_tree(cell).torque.max() == pytest.approx(4.0, rel=0.01)
    assert abs(gap(cell, cell.robot.home)[2]) < 1e-3


def test_hardcoded_pinches_along_the_short_axis(tmp_path):
    _, _, cell = made(tmp_path, SLIDES)
    agent = HardcodedAgent()
    env = gym.make("DexGrasp/Lift-v2", objects="pill_bottle", robot=cell, **agent.env_settings)
    observation, info = env.reset(seed=3)
    agent.seed(3)
    agent.reset(observation, info)
    assert agent.report.failure is None
    assert finished(env, agent, observation)["is_success"]
