"""`scripts/fuzz.py`: cases follow from seed and number; a short run of those that take no time."""

import importlib.util
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from dexgrasp.cli import checks

SCRIPTS = Path(__file__).parents[1] / "scripts"


@pytest.fixture(scope="module")
def fuzz():
    spec = importlib.util.spec_from_file_location("fuzz", SCRIPTS / "fuzz.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["fuzz"] = module
    spec.loader.exec_module(module)
    return module


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


def test_cases_follow_from_seed_and_number(fuzz, good, tmp_path):
    def make(k, name):
        (tmp_path / name).mkdir()
        argv, _ = fuzz.case_argv("mesh", np.random.default_rng([0, k]), good, tmp_path / name)
        return Path(argv[1]).read_bytes()

    assert make(3, "a") == make(3, "b") != make(4, "c")


@pytest.mark.parametrize("kind", ["arguments", "run"])
def test_a_short_run_ends_in_0_to_3(kind, fuzz, good, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in (
        "check_versions",
        "check_rendering",
        "check_machine",
    ):  # run_here replaces them: put them back
        monkeypatch.setattr(checks, name, getattr(checks, name))
    for k in range(60):
        here = tmp_path / f"{kind}{k}"
        here.mkdir()
        argv, wanted = fuzz.case_argv(kind, np.random.default_rng([1, k]), good, here)
        if kind == "run":
            argv = ["compare", str(here / "run"), "random", "hardcoded"]
        elif argv[0] in ("plan", "demo", "evaluate", "train", "view", "doctor"):
            continue  # some of these work, which takes time
        code, said = fuzz.run_here(argv, wanted)
        assert code in fuzz.ALLOWED, (argv, said)


def test_a_log_goes_on_after_a_line_that_was_cut_off(fuzz, tmp_path):
    path = tmp_path / "out" / "log.jsonl"
    with fuzz.JsonLog(path, "case") as log:
        log.add({"case": 0, "code": 2})
        log.add({"case": 1, "code": 0})
    path.write_bytes(path.read_bytes() + b'{"case": 2, "co')
    with fuzz.JsonLog(path, "case") as log:
        assert list(log.rows) == [0, 1]
        log.add({"case": 0, "code": 0})
    with fuzz.JsonLog(path, "case") as log:
        assert log.rows == {0: {"case": 0, "code": 0}, 1: {"case": 1, "code": 0}}
