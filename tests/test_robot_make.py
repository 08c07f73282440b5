"""What a user tells `robot make`, what it draws, recipes of known hands, and the faults of drives and masses."""

import json

import numpy as np
import pytest
import yaml
from processes import typed
from refusals import refused
from robots import variant
from test_grippers import SLIDES, made
from test_robot_sources import FINGERS, urdf

from dexgrasp.mechanics.kinematics.robot_check import check_robot
from dexgrasp_env.robot.cell import make_cell
from dexgrasp_env.robot.hand_maker import NamedParts
from dexgrasp_env.robot.make import make_robot
from dexgrasp_env.robot.model import bodies_apart, compiled_robot, posed
from dexgrasp_env.robot.recipes import recipe_of, recipes


@pytest.fixture
def hand(tmp_path):
    path = tmp_path / "claw.urdf"
    path.write_text(urdf())
    return path


def file_of(hand, named=None):
    make_robot(hand, None, hand.with_name("claw.yaml"), named)
    return yaml.safe_load(hand.with_name("claw_hand.yaml").read_text())


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
    make_robot(hand, None, hand.with_name("claw.yaml"), recipe=recipe_of("dclaw", hand))
    assert yaml.safe_load(hand.with_name("claw_hand.yaml").read_text())["torque"] == 3.0
    with refused("unknown recipe 'claw'"):
        recipe_of("claw", hand)
    with refused("of dexsuite/dex-urdf: give that file"):
        recipe_of("svh", None)


def test_idle_fingers_are_spread_no_farther_than_they_have_room(hand):
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
    assert min(bodies_apart(data, a, b, 0.05) for a in ends[0] for b in ends[1]) > 0.0025


def test_masses_and_drives_that_no_hand_has_are_named(tmp_path):
    heavy = SLIDES.replace('mass="0.5"', 'mass="500"')
    found = check_robot(made(tmp_path, heavy)[2])
    warnings = [f.problem for f in found if f.level == "warning"]
    assert sum("case" in problem or "the hand has" in problem for problem in warnings) == 2
    found = check_robot(
        make_cell(variant(tmp_path, tmp_path / "mine.yaml", hand={"upper": 4e-4, "open": [2e-4, 2e-4]}))
    )
    assert [f.level for f in found if "moves nothing" in f.problem] == ["error"]
