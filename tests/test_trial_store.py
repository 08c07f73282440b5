"""The folder of an evaluation: cut off, damaged, of something else, written to twice."""

import json

import pytest
from refusals import refused
from tables import mistakes
from trial_rows import row, write_run

from dexgrasp.evaluation.store import TrialStore, kept_grasps, read_rows


def test_two_writers_are_refused(tmp_path):
    store = TrialStore(tmp_path, {})
    with refused("another process is writing"):
        TrialStore(tmp_path, {})
    store.close()


def test_a_trial_counts_once(tmp_path):
    line = json.dumps(row(success=True)) + "\n"
    (tmp_path / "trials.jsonl").write_text(line * 3)
    assert len(read_rows(tmp_path)) == 1
    (tmp_path / "run.json").write_text('{"seed": 1}')
    store = TrialStore(tmp_path, {"seed": 1})
    assert len(store.rows) == 1
    store.close()


@pytest.mark.parametrize(
    "line",
    ["[]", "{}", *(json.dumps(row() | change) for change in mistakes("trials"))],
)
def test_damaged_lines_are_named_in_one_line(tmp_path, line):
    (tmp_path / "trials.jsonl").write_text(line + "\n")
    with refused(r"line 1 is (not JSON|no trial)"):
        read_rows(tmp_path)


def test_grasps_of_trials_that_fell_short_come_first(tmp_path):
    rows = [row(trial=k, success=k != 2, grasp=f"grasps/lift-{k}.json") for k in range(4)]
    rows[3]["clean"] = False
    write_run(tmp_path, [*rows, row(trial=4)])
    with refused("holds no grasps"):
        kept_grasps(tmp_path)
    (tmp_path / "grasps").mkdir()
    for k in range(4):
        (tmp_path / "grasps" / f"lift-{k}.json").touch()
    assert [file.stem for file in kept_grasps(tmp_path)] == ["lift-2", "lift-3", "lift-0", "lift-1"]
