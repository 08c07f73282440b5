"""`scripts/fuzz.py`: cases follow from seed and number; a short run of those that take no time."""

import json
from pathlib import Path

import numpy as np
import pytest
from project_scripts import load_script

SCRIPTS = Path(__file__).parents[1] / "scripts"


@pytest.fixture(scope="module")
def fuzz():
    return load_script("fuzz")


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A run folder as `evaluate` leaves it, without the running."""
    folder = tmp_path_factory.mktemp("good")
    (folder / "run").mkdir()
    rows = [
        {"protocol": "lift", "agent": agent, "object": "sugar_box", "trial": k, "success": k > 0, "stable": False,
         "scene_seed": k, "agent_seed": k, "reason": "dropped", "planning_seconds": 1.0, "details": {}}
        for agent in ("random", "hardcoded") for k in range(2)
    ]  # fmt: skip
    run = {
        "agents": ["random", "hardcoded"],
        "objects": ["sugar_box"],
        "trials": 2,
        "seed": 0,
        "protocol": "lift",
    }
    (folder / "run" / "trials.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    for name in ("run.json", "summary.json"):
        (folder / "run" / name).write_text(json.dumps(run))
    return folder


@pytest.mark.parametrize("kind", ["mesh", "cloud"])
def test_cases_follow_from_seed_and_number(kind, fuzz, good, tmp_path):
    def make(k, name):
        (tmp_path / name).mkdir()
        fuzz.make_case(kind, np.random.default_rng([0, k]), good, tmp_path / name)
        (path,) = (tmp_path / name).iterdir()
        return path.read_bytes()

    assert make(3, "a") == make(3, "b") != make(4, "c")


@pytest.mark.parametrize("kind", ["arguments", "run"])
def test_a_short_run_ends_in_0_to_3(kind, fuzz, good, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for k in range(60):
        here = tmp_path / f"{kind}{k}"
        here.mkdir()
        case = fuzz.make_case(kind, np.random.default_rng([1, k]), good, here)
        if kind == "run":
            case = fuzz.Case(["compare", str(here / "run"), "random", "hardcoded"])
        elif case.argv[0] in ("plan", "demo", "evaluate", "train", "view", "doctor"):
            continue  # some of these work, which takes time
        code, said = fuzz.run_case(case)
        assert code in fuzz.ALLOWED, (case.argv, said)


def test_a_process_that_dies_or_raises_is_a_fault_and_the_next_case_runs(fuzz, tmp_path):
    worker = fuzz.Worker()
    assert worker.run(fuzz.Case(["list", "nosuch"]), str(tmp_path))[0] == 2
    worker._process.kill()
    code, said = worker.run(fuzz.Case(["list", "nosuch"]), str(tmp_path))
    assert code == -9, said
    assert worker.run(fuzz.Case(["list", "objects"]), str(tmp_path))[0] == 0
