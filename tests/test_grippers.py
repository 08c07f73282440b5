"""Grippers, sliding or on closed loops, read, checked, carried out; and what a user tells `robot make` of any hand."""

import json

import gymnasium as gym
import numpy as np
import pytest
import yaml
from lift_envs import finished
from numpy.testing import assert_allclose
from processes import typed
from refusals import refused
from robots import variant
from test_robot_sources import FINGERS, hand_of, urdf, written

from dexgrasp.agents.hardcoded import HardcodedAgent
from dexgrasp.mechanics.kinematics.robot_check import check_robot
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.planning.atlas import hand_atlas
from dexgrasp_env.robot.cell import make_cell
from dexgrasp_env.robot.make import make_robot
from dexgrasp_env.robot.model import bodies_apart, compiled_robot, posed
from dexgrasp_env.robot.part import NamedParts
from dexgrasp_env.robot.recipes import recipe_of, recipes

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


BRACKETS = SLIDES.replace(
    '<geom type="box" size="0.009',
    '<geom type="box" size="0.004 0.014 0.005" pos="0.005 -0.004 0.005"/><geom type="box" size="0.009',
)
"""Jaws of which a bracket reaches over the middle, far behind the pads."""


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


@pytest.mark.parametrize("text", [SLIDES, LOOPS, BRACKETS, SLIDES.replace(' range="0 0.045"', "")])
def test_nothing_is_wrong_with_what_is_made_of_a_gripper(text, tmp_path):
    _, _, cell = made(tmp_path, text)
    assert [finding for finding in check_robot(cell) if finding.level == "error"] == []
    assert hand_atlas(cell).tips.least < 0.5**0.5  # tips' axes are at 45 degrees to the way jaws close


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


@pytest.fixture
def hand(tmp_path):
    return written(tmp_path)


def file_of(hand, *told):
    return hand_of(hand.parent, hand, *told)[1]


def test_a_thumb_that_is_named_opposes_and_a_pad_that_is_flipped_turns(hand):
    as_found, named = file_of(hand), file_of(hand, NamedParts(thumb="fore_far", flip=("mid_far",)))
    ends = {f["name"]: f["bodies"][-1] for f in named["fingers"]}
    assert ends[named["grasp"][0]] == "fore_far"
    frames = [
        next(f["frame"]["quat_wxyz"] for f in of["fingers"] if f["bodies"][-1] == "mid_far")
        for of in (as_found, named)
    ]
    assert abs(np.dot(*frames)) < 0.1  # half a turn


def test_a_body_that_is_not_there_is_refused_with_those_that_are(hand):
    with refused("unknown body 'plato'.*plate"):
        file_of(hand, NamedParts(palm="plato"))


def test_one_file_is_made_without_being_told_what_it_is_and_drawn(hand, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert typed(f"robot make {hand} --json") == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["robot"], said["picture"]) == ("claw.yaml", "claw.png")
    assert (tmp_path / "claw.png").stat().st_size > 10_000


def test_recipes_replace_what_a_file_states(hand):
    assert {"svh", "franka_hand", "robotiq_2f85", "umi", "inspire"} <= recipes().keys()
    assert file_of(hand, None, recipe_of("dclaw", hand))["torque"] == 3.0
    with refused("unknown recipe 'claw'"):
        recipe_of("claw", hand)
    with refused("of dexsuite/dex-urdf: give that file"):
        recipe_of("svh", None)


def test_idle_fingers_keep_clear_of_each_other_as_open_hands_do(hand):
    straight = ("0 0 0", (0, 1.6))
    more = {
        "fourth": ("0 -0.095 0", *straight, 0.5),
        "fifth": ("0 -0.118 0", *straight, 0.01),
    }  # no room to spread
    hand.write_text(urdf(fingers=FINGERS | more))
    file_of(hand)
    cell = make_cell(hand.with_name("claw.yaml"))
    idle = [finger for finger in cell.robot.hand.fingers if finger.aside]
    assert len(idle) == 2
    q = cell.robot.home.copy()
    for finger in idle:
        q[cell.robot.columns[finger.name]] = finger.aside
    data, model = posed(compiled_robot(cell), q), compiled_robot(cell)
    ends = [[model.body(name).id for name in finger.bodies] for finger in idle]
    apart = np.array([[bodies_apart(data, a, b, 0.05) for a in ends[0]] for b in ends[1]])
    assert apart[0, 0] > 0.0025  # first links
    assert apart[1:, 1:].min() > 0.004


def test_masses_and_drives_that_no_hand_has_are_named(tmp_path):
    heavy = SLIDES.replace('mass="0.5"', 'mass="500"')
    found = check_robot(made(tmp_path, heavy)[2])
    warnings = [f.problem for f in found if f.level == "warning"]
    assert sum("case" in problem or "the hand has" in problem for problem in warnings) == 2
    found = check_robot(
        make_cell(variant(tmp_path, tmp_path / "mine.yaml", hand={"upper": 4e-4, "open": [2e-4, 2e-4]}))
    )
    assert [f.level for f in found if "moves nothing" in f.problem] == ["error"]
