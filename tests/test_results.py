"""Results of record: pages show what the JSON files hold; certificates as predictions."""

import json

import numpy as np
import pytest
from project_scripts import load_script

from dexgrasp.evaluation.prediction import auc, predictions
from dexgrasp.evaluation.report.figures import reliability

record_results = load_script("record_results")


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
