"""Faults of robots and of their files: `robot check` finds each with its mend, what is broken is said in a line."""

import re

import pytest
import yaml
from foreign_parts import ALLEGRO, foreign_hand
from processes import typed
from robots import variant
from tables import mistakes

from dexgrasp.mechanics.kinematics.robot_check import check_robot
from dexgrasp.planning.payload import payload
from dexgrasp_env.robot.cell import make_cell
from dexgrasp_env.robot.make import make_robot


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    make_robot(foreign_hand(folder), None, folder / "theirs.yaml")
    return folder / "theirs.yaml"


SLOW = pytest.mark.slow
_BACKWARDS = [0.5**0.5, 0.0, 0.5**0.5, 0.0]


def _shifted(hand: dict, finger: int, frame: dict) -> dict:
    fingers = [dict(entry) for entry in hand["fingers"]]
    fingers[finger]["frame"] = fingers[finger]["frame"] | frame
    return {"fingers": fingers}


@pytest.mark.parametrize(
    ("change", "problem", "mend"),
    [
        (lambda h: {"open": h["lower"]}, "in front of the palm", "bend `open` further"),
        (lambda h: {"open": [-0.4, 1.5, 0.8, 0.8, 0.4, 1.5, 0.8, 0.8, -0.4, 1.5, 0.8, 0.8, *h["open"][12:]]},
         "touch with the hand open", "change `open`"),
        pytest.param(lambda h: {"stiffness": 0.01}, "follows its servo by", "raise its stiffness", marks=SLOW),
        (lambda h: _shifted(h, 0, {"position": [0.0, 0.0, 0.1]}), "mm from its centre", "shift the tip's frame"),
        (lambda h: _shifted(h, 3, {"quat_wxyz": [0.0, 0.0, 0.0, 1.0]}), "looks away|face each other", "tip.s frame"),
        pytest.param(lambda h: {"upper": [*h["upper"][:12], *(q + 0.01 for q in h["lower"][12:])],
                    "open": [*h["open"][:12], *h["lower"][12:]]}, "face each other", "wider ranges", marks=SLOW),
        pytest.param(lambda h: {"mounts": {"palm_normal": {"position": [0.0, 0.0, 0.3], "quat_wxyz": _BACKWARDS}}},
         "palm poses over the table are reached", "`home` or `starts`", marks=SLOW),
    ],
)  # fmt: skip
def test_the_check_finds_a_fault_and_says_its_mend(change, problem, mend, made, tmp_path):
    hand = yaml.safe_load(made.with_name("theirs_hand.yaml").read_text())
    cell = make_cell(variant(tmp_path, made, hand=change(hand)))
    found = [finding for finding in check_robot(cell) if finding.level != "info"]
    assert any(re.search(problem, f.problem) and re.search(mend, f.remedy) for f in found), found


def test_what_a_hand_lifts_grows_with_its_torques(tmp_path):
    weak = make_cell(variant(tmp_path, hand={"torque": 0.35}))
    assert payload(weak) == pytest.approx(0.5 * payload(make_cell()), rel=1e-6)


@pytest.mark.parametrize(("changes", "problem"), mistakes("descriptions"))
def test_the_check_finds_a_fault_of_a_description(changes, problem, tmp_path, capsys):
    text = ALLEGRO.read_text().replace('meshdir="', f'meshdir="{ALLEGRO.parent}/')
    for pattern, by, count in changes:
        text, found = re.subn(pattern, by, text, count=count)
        assert found
    (tmp_path / "hand.xml").write_text(text)
    typed(f"robot check {variant(tmp_path, hand={'mjcf': 'hand.xml'})}")
    said = capsys.readouterr()
    assert re.search(problem, said.out + said.err)
    assert "Traceback" not in said.err


@pytest.mark.parametrize(
    ("changes", "words"), [*(({"hand": own}, words) for own, words in mistakes("hands")), *mistakes("robots")]
)
def test_a_broken_hand_arm_or_robot_is_said_in_one_line(changes, words, tmp_path, capsys):
    assert typed(f"robot check {variant(tmp_path, **changes)}") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(words, line)
