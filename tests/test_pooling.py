"""Evaluations that differ in their seed alone are one sample."""

import pytest
from processes import typed
from trial_rows import row, write_run

from dexgrasp.evaluation.pooling import rows_by_agent


def run_folder(folder, seed, successes, agents=("x", "y"), **more):
    rows = [
        row(agent, trial=t, success=ok, scene_seed=10 * seed + t, protocol="lift")
        for agent in agents
        for t, ok in enumerate(successes)
    ]
    identity = {
        "agents": list(agents),
        "objects": ["soda"],
        "trials": 2,
        "seed": seed,
        "versions": {},
        **more,
    }
    return write_run(folder, rows, **identity)


def test_seeds_of_one_experiment_are_one_sample(tmp_path):
    folders = [
        run_folder(tmp_path / "a", 1, [True, False]),
        run_folder(tmp_path / "b", 2, [True, True], agents=("y",)),
    ]
    found = rows_by_agent(folders)
    assert list(found) == ["x", "y"]
    assert [r["scene_seed"] for r in found["y"]] == [10, 11, 20, 21]


@pytest.mark.parametrize("more", [{"code": "other"}, {"objects": ["pear"]}, {"trials": 3}])
def test_other_experiments_are_not(tmp_path, more):
    folders = [run_folder(tmp_path / "a", 1, [True]), run_folder(tmp_path / "b", 2, [False], **more)]
    assert {name: len(rows) for name, rows in rows_by_agent(folders).items()} == {
        "x": 1, "y": 1, "x (b)": 1, "y (b)": 1,
    }  # fmt: skip


def test_the_same_seed_again_counts_for_itself(tmp_path):
    folders = [run_folder(tmp_path / name, 1, [True]) for name in "ab"]
    assert list(rows_by_agent(folders)) == ["x", "y", "x (b)", "y (b)"]


def test_pushes_are_judged_in_comparisons_as_in_reports(tmp_path, printed):
    folder = run_folder(tmp_path / "a", 1, [])
    rows = [
        row(agent, success=agent == "y" or protocol == "pushed@1", protocol=protocol)
        for agent in ("x", "y")
        for protocol in ("pushed@0.5", "pushed@1")
    ]
    write_run(folder, rows)
    assert typed(f"compare {folder} x y --json") == 0
    assert printed()["only_b"] == 2
