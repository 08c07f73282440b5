"""`scripts/fuzz.py`: a short run of those that take no time."""

import json
from collections import Counter

import pytest
from project_scripts import load_script
from tables import table
from trial_rows import row, write_run

from dexgrasp.cli.main import main


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
    run = table("run")
    write_run(folder / "run", rows, **run)
    (folder / "run" / "summary.json").write_text(json.dumps(run))
    return folder


def is_short(argv):
    """Some other commands work, which takes time."""
    return argv[0] not in ("plan", "demo", "evaluate", "train", "view", "doctor", "replay", "report")


@pytest.mark.parametrize("kind", ["arguments", "run", "mesh", "cloud"])
def test_a_short_run_ends_in_0_to_3(kind, fuzz, good, tmp_path, monkeypatch):
    monkeypatch.setattr(load_script("clouds"), "dexgrasp", lambda argv: main(argv) if is_short(argv) else 2)
    codes = Counter()
    fuzz.fuzz(kind, 40, 1, good, tmp_path, codes)
    assert sum(codes.values()) >= 20
    assert {int(name.split()[1]) for name in codes} <= set(fuzz.ALLOWED)
