"""How likely a grasp holds: figures, model, file, `plan --at-least`."""

import json
from dataclasses import replace

import numpy as np
import pytest
from processes import typed
from robots import CELL, HOME

from dexgrasp.cli.codes import ANSWER_IS_NO, OK
from dexgrasp.geometry.request import GraspRequest
from dexgrasp.grasp.file import record_of
from dexgrasp.grasp.probability import OUTCOMES, probability_of, shipped_model
from dexgrasp.grasp.probability_features import features_of
from dexgrasp.grasp.record import as_json
from dexgrasp.planning.diverse import UNSURE, chances_of, with_success_probability
from dexgrasp.planning.planner import Planner, small_box
from dexgrasp.planning.result import PlanResult


@pytest.fixture(scope="module")
def found():
    return Planner().plan(small_box(), 0, HOME)


@pytest.fixture(scope="module")
def record(found):
    return record_of(found.contents("box")[0])


def test_more_friction_and_less_weight_hold_better(record):
    mass = record.certificate.mass
    frictions = [shipped_model().chances(features_of(record, mu, mass, 0.0)) for mu in (0.3, 0.5, 0.7, 0.9)]
    for name in OUTCOMES:
        values = [chances[name].value for chances in frictions]
        assert values == sorted(values)
        assert all(c[name].low <= c[name].value <= c[name].high for c in frictions)
    heavy, light = (features_of(record, 0.4, times * mass, 0.0) for times in (3.0, 1.0))
    assert heavy["slips"] >= light["slips"]
    assert heavy["borne"] < light["borne"]


def test_a_file_states_what_the_model_says_of_it(found, record):
    stated = record.holds_probability
    assert stated is not None
    assert stated == probability_of(record)
    assert stated.model == shipped_model().hash
    assert stated.mass == record.certificate.mass
    assert stated.friction == pytest.approx(0.7)
    assert stated.lifted.value == chances_of(found.found[0], found).lifted.value
    assert record_of(json.loads(json.dumps(as_json(record)))).holds_probability == stated


def test_nothing_is_said_of_what_no_trials_have_tested(record):
    other = replace(record, robot=replace(record.robot, hash="00000000"))
    slippery = replace(record, thresholds=replace(record.thresholds, friction=0.4, friction_hold=0.5))
    gentle = replace(record, request=GraspRequest(max_force=8.0))
    content = as_json(record)
    some = {"name": None, "pose": np.eye(4).tolist(), "parts": content["parts"]}
    among = record_of(content | {"neighbours": [some]})
    assert [probability_of(one) for one in (other, slippery, gentle, among)] == [None] * 4


def test_a_side_that_no_camera_saw_is_less_sure(record):
    seen, hidden = probability_of(record), probability_of(record, 0.003)
    assert hidden.lifted.value < 0.95 < seen.lifted.value
    assert hidden.lifted.low < hidden.lifted.value < hidden.lifted.high


def asked(min_probability):
    planner = Planner(cell=CELL).asking(GraspRequest(min_probability=min_probability))
    return planner, with_success_probability(planner.plan(small_box(), 0, HOME), planner, HOME)


def test_a_grasp_is_as_sure_as_asked_or_there_is_none(found):
    chance = chances_of(found.found[0], found).lifted.value
    _, sure = asked(0.5 * chance)
    assert np.array_equal(sure.grasp.q, found.grasp.q)
    planner, none = asked(0.999999)
    assert not none.success
    assert none.reason == f"no_grasp:{UNSURE}"
    assert 0.0 < none.log.blocked[UNSURE][1] < 1.0
    nothing = PlanResult(small_box(), planner.settings, shortfall="no_closure_triple")
    assert with_success_probability(nothing, planner, HOME).reason == "no_grasp:no_closure_triple"


def test_plan_at_least(printed, capsys):
    assert typed("plan pear --at-least 0.6 --json") == OK
    assert printed()["grasp"]["holds_probability"]["lifted"]["value"] >= 0.6
    assert typed("plan pear --at-least 0.99999") == ANSWER_IS_NO
    assert "not_sure_enough" in capsys.readouterr().out
