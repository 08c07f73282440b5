"""Results of record: pages show what the JSON files hold."""

import json

import pytest
from project_scripts import load_script

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
