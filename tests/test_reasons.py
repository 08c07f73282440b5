"""Reasons in words: every code that the project gives is known, and people are told what to try."""

from dexgrasp.evaluation.reasons import REASONS, explain
from dexgrasp.evaluation.trial import NOT_HELD
from dexgrasp.geometry import completion
from dexgrasp.planning import cvae_source, planner, proposals

UNSEEN = ["object_out_of_view", "too_few_points", "plane_not_found"]  # of simulated depth images
PLANNERS = [
    planner.NO_POSTURE,
    planner.BUDGET,
    proposals._NO_CLOSURE,
    proposals._NO_SURFACE,
    completion.NO_CLOUD,
]


def test_every_code_has_a_sentence():
    codes = [*PLANNERS, completion.NO_VOLUME, cvae_source._NO_CLOSURE, *UNSEEN, *NOT_HELD.values()]
    assert [code for code in codes if code not in REASONS] == []
    assert all(reason.sentence and not reason.sentence.endswith(".") for reason in REASONS.values())


def test_what_blocked_how_often_by_how_much_and_a_hint():
    blocked = {"clearance_hand_table:index": 7, "clearance_hand_table:thumb": 5, "approach_blocked": 2}
    text = explain("no_grasp:clearance_hand_table", blocked, {"clearance_hand_table:index": 0.0031})
    assert "of 14 postures" in text
    assert "12  the hand would touch the table, by 3.1 mm at least" in text
    assert "2  there is no way to the grasp" in text
    assert text.splitlines()[-1].strip().startswith("hint: low objects")
