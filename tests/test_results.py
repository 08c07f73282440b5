"""Results of record: pages show what the JSON files hold; certificates as predictions."""

import json

import numpy as np
import pytest
from project_scripts import load_script

from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.prediction import auc, predictions
from dexgrasp.evaluation.report.figures import reliability

record_results = load_script("record_results")
load_predicts = load_script("load_predicts")


def test_every_page_shows_what_the_json_holds():
    shown = set()
    for path in record_results.pages():
        text = path.read_text()
        shown |= set(record_results.shown(text))
        assert record_results.rewritten(text) == text, f"{path.name}: run scripts/record_results.py --write"
    results = record_results.RESULTS
    seasons = {
        f"{run.parents[1].name}/{run.parent.name.rpartition('-')[0]}" for run in results.glob("*/*/run.json")
    }
    assert shown == {path.stem for path in results.glob("*.json")} | seasons


def test_rates_follow_from_counts():
    for path in record_results.RESULTS.glob("*.json"):
        content = json.loads(path.read_text())
        assert content["commands"]
        assert all("--seed" in command for command in content["commands"])
        for agent in content["agents"].values():
            for cell in agent["by_set"].values():
                assert cell["rate"] == pytest.approx(cell["successes"] / cell["trials"])
                assert cell["ci95"][0] <= cell["rate"] <= cell["ci95"][1]


def test_commands_that_differ_in_their_seed_are_shown_once():
    commands = [f"evaluate --trials 3 --seed {seed} --out runs/robust_{seed}" for seed in (1000, 1001)]
    assert record_results._together(commands) == [
        "# S = 1000, 1001",
        "evaluate --trials 3 --seed S --out runs/robust_S",
    ]
    assert record_results._together(commands[:1]) == commands[:1]


def test_pushes_of_a_grasp_are_not_independent():
    """Of ten grasps, one that fails at every push is wider than as many failures spread over all of them."""

    def rows(failed):
        pushed = [
            {"target": "pear", "seed": k, "planned": True, "load": 2.0, "pushes": [
                {"share": 1.0, "ramp": 2, "failed": failed(k, n)} for n in range(10)
            ]} for k in range(10)
        ]  # fmt: skip
        return load_predicts.summary(pushed)["at_1.0"]

    clustered, spread = rows(lambda k, n: k == 0), rows(lambda k, n: k == n)
    assert clustered["pushes"] == spread["pushes"] == 100
    assert clustered["failed"] == spread["failed"] == 10
    assert np.ptp(clustered["ci95"]) > 2.0 * np.ptp(spread["ci95"])


def test_pushes_go_where_object_seed_and_number_say():
    first = load_predicts.directions("pear", 40, 3)
    assert np.array_equal(load_predicts.directions("pear", 40, 6)[:3], first)
    assert len({tuple(row) for row in first}) == 3
    for other in (load_predicts.directions("soda", 40, 3), load_predicts.directions("pear", 41, 3)):
        assert not np.isclose(other, first).any()


def test_grasps_with_other_pushes_are_not_taken_for_done(tmp_path, monkeypatch):
    monkeypatch.setattr(load_predicts, "run_pool", lambda work, jobs, backend: [])
    monkeypatch.setattr(load_predicts, "summary", lambda rows: {})
    words = ["--objects", "pear", "--out", str(tmp_path / "out")]
    assert run_script(load_predicts.Load, [*words, "--pushes", "2"]) == 0
    assert run_script(load_predicts.Load, [*words, "--pushes", "2"]) == 0
    assert run_script(load_predicts.Load, [*words, "--pushes", "3"]) == 2


def row(load, success):
    return {"success": success, "details": {"certificate": {"load": load}}}


def test_area_under_the_curve_of_known_orders():
    values = np.arange(10.0)
    assert auc(values, values >= 5) == 1.0
    assert auc(values, values < 5) == 0.0
    assert auc(np.ones(10), values >= 5) == 0.5
    assert auc(values, np.ones(10, bool)) == 0.5
    # 2 of the 3 successes are above the one failure
    assert auc(np.array([1.0, 2.0, 3.0, 4.0]), np.array([True, False, True, True])) == pytest.approx(2 / 3)


def test_predictions_of_trials():
    rows = [row(1.0 + 0.1 * k, k >= 10) for k in range(40)] + [{"success": False, "details": {}}]
    found = predictions(rows)
    assert list(found) == ["load"]
    assert found["load"].trials == 40
    assert found["load"].auc == 1.0
    assert [b.successes for b in found["load"].bins] == [0, 10, 10, 10]
    assert predictions([row(2.0, True)] * 20) == {}
    said = [{"lifted": {"value": 0.02 * k}, "pushed": {"value": 1.0 - 0.02 * k}} for k in range(40)]
    for line, chances in zip(rows, said, strict=False):
        line["details"]["holds_probability"] = chances
    found = predictions(rows)
    assert list(found) == ["load", "lifted", "pushed"]
    assert (found["lifted"].auc, found["pushed"].auc) == (1.0, 0.0)
    assert reliability({"bilevel": found})[1].name == "reliability_lifted"
    assert predictions([row(None, True), row("x", False)]) == {}
