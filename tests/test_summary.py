"""Statistics, summaries, tables and reports."""

import numpy as np
import pytest
from trial_rows import row

from dexgrasp.evaluation.report.build import write_report
from dexgrasp.evaluation.report.tables import render_summary
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.evaluation.statistics import mcnemar, wilson_interval
from dexgrasp.evaluation.store import TrialStore
from dexgrasp.evaluation.summary import present_sets, summarise, summarise_agent
from dexgrasp_env.objects.catalogue import OBJECT_SETS


def test_wilson_interval_against_published_values():
    # Newcombe (1998), table I, method 3: 81/263, 15/148, 0/20, 1/29.
    for k, n, low, high in [
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ]:
        assert wilson_interval(k, n) == pytest.approx((low, high), abs=5e-5)
    assert wilson_interval(5, 5)[1] == 1.0
    assert wilson_interval(0, 0) == (0.0, 1.0)
    with pytest.raises(ValueError, match="3 successes"):
        wilson_interval(3, 2)


def test_mcnemar_is_exact():
    result = mcnemar((i < 9, 8 <= i < 10) for i in range(20))
    assert [result[k] for k in ("both", "only_a", "only_b", "neither")] == [1, 8, 1, 10]
    assert result["p_value"] == pytest.approx(2 * (1 + 9) / 2**9)
    assert mcnemar([(True, True), (False, False)])["p_value"] == 1.0


def some_rows(agent, seed):
    rng = np.random.default_rng(seed)
    rows = []
    for name in (*OBJECT_SETS["seen"], *OBJECT_SETS["familiar"], *OBJECT_SETS["novel"], "my_mesh"):
        for trial in range(3):
            certificate = {
                "distances_cm": rng.uniform(-0.7, -0.3, 3).tolist(), "force_ratio_percent": float(rng.random()),
                "torque_ratio_percent": float(rng.random()), "closure_margin": 0.1, "holds": True,
            }  # fmt: skip
            details = {"certificate": certificate, "stage_seconds": {"ik": 0.1}, "stage_repeats": {"ik": 2}}
            rows.append(row(agent, name, trial, bool(rng.random() < 0.7), details=details))
    return rows


def test_sets_are_counted_apart():
    agent = summarise_agent(some_rows("bilevel", 0))
    assert {name: cell["trials"] for name, cell in agent["by_set"].items()} == {
        "seen": 9, "familiar": 12, "novel": 39, "meshes": 3,
    }  # fmt: skip
    assert set(present_sets(list(OBJECT_SETS["ycb6"]))) == {"seen", "ycb6"}


def test_trials_in_other_physics_are_averaged_into_nothing():
    rows = [
        row("rl", "pear", k, k < 2, protocol=p)
        for p in ("lift", "lift@warp")
        for k in range(2 if p == "lift" else 4)
    ]
    agent = summarise_agent(rows)
    assert (agent["trials"], agent["successes"]) == (2, 2)
    assert agent["by_object"]["pear"]["trials"] == 2
    assert {name: own["rate"] for name, own in agent["by_protocol"].items()} == {
        "lift": 1.0,
        "lift@warp": 0.5,
    }
    assert summarise_agent(rows[2:])["trials"] == 4


def test_constraints_as_tables_4_to_6():
    rows = some_rows("bilevel", 0)
    agent = summarise_agent(rows)
    distances = [d for r in rows for d in r["details"]["certificate"]["distances_cm"]]
    found = agent["constraints"]
    assert (found["grasps"], found["hold"]) == (63, 63)
    assert found["distance_cm"]["median"] == pytest.approx(np.median(distances))
    assert found["distance_cm"]["max_violation"] == pytest.approx(
        max(0, -0.68 - min(distances), max(distances) + 0.32)
    )
    assert set(found["by_set"]) == {"seen", "familiar", "novel", "meshes"}
    assert found["torque_ratio_percent"]["p75"] <= 1.0
    assert agent["stages"]["overall"]["stage_seconds"]["ik"]["median"] == pytest.approx(0.1)
    assert summarise_agent([row()])["constraints"] == {}


def test_paired_comparison_and_table():
    settings = EvaluationSettings(("bilevel", "hardcoded"), ("soda",), trials=2)
    rows = [
        row("bilevel", trial=0, success=True),
        row("bilevel", trial=1, success=True),
        row("hardcoded", trial=0),
    ]
    summary = summarise(settings, rows)
    assert summary["complete"] is False
    assert summary["paired"][0]["only_a"] == 1
    text = render_summary(summary)
    assert "2/2 (6/6)" in text  # ours (the paper's)
    assert "95.8 % 23/24" not in text.splitlines()[2]
    assert "dropped" in text


def test_report_has_the_papers_tables_beside_ours(tmp_path):
    for name, seed in (("bilevel", 0), ("hardcoded", 1)):
        store = TrialStore(
            tmp_path / name, {"protocol": "lift-v0", "seed": 0, "trials": 3, "versions": {"mujoco": "3"}}
        )
        for line in some_rows(name, seed):
            store.append(line)
        store.close()
    text = write_report([tmp_path / "bilevel", tmp_path / "hardcoded"], tmp_path / "report")
    for words in ("Table 1", "Table 2", "Table 3", "Table 4", "Table 5", "Table 6", "94.4 % 17/18", "38.5 % 15/39",
                  "McNemar", "my_mesh", "0.01 (0.00, 8.48)"):  # fmt: skip
        assert words in text, words
    assert (tmp_path / "report" / "report.md").read_text() == text
    for plot in ("success_by_set.png", "success_by_object.png"):
        assert (tmp_path / "report" / plot).stat().st_size > 10_000
