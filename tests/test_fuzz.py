"""`scripts/fuzz.py`: cases follow from seed and number; a short run of those that take no time."""

import json
from pathlib import Path

import numpy as np
import pytest
from project_scripts import load_script
from trial_rows import row, write_run

SCRIPTS = Path(__file__).parents[1] / "scripts"


@pytest.fixture(scope="module")
def fuzz():
    return load_script("fuzz")


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A run folder as `evaluate` leaves it, without the running."""
    folder = tmp_path_factory.mktemp("good")
    rows = [
        row(agent, "sugar_box", k, k > 0, protocol="lift", agent_seed=k)
        for agent in ("random", "hardcoded")
        for k in range(2)
    ]
    run = {
        "agents": ["random", "hardcoded"],
        "objects": ["sugar_box"],
        "trials": 2,
        "seed": 0,
        "protocol": "lift",
    }
    write_run(folder / "run", rows, **run)
    (folder / "run" / "summary.json").write_text(json.dumps(run))
    return folder


@pytest.mark.parametrize("kind", ["mesh", "cloud"])
def test_cases_follow_from_seed_and_number(kind, fuzz, good, tmp_path):
    def make(k, name):
        (tmp_path / name).mkdir()
        fuzz.make_case(kind, np.random.default_rng([0, k]), good, tmp_path / name)
        return [path.read_bytes() for path in sorted((tmp_path / name).iterdir())]

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
    for process in worker.pool._processes.values():
        process.kill()
    code, said = worker.run(fuzz.Case(["list", "nosuch"]), str(tmp_path))
    assert code == -9, said
    assert worker.run(fuzz.Case(["list", "objects"]), str(tmp_path))[0] == 0
