"""Statistics, summaries, tables and reports."""

import numpy as np
import pytest
from trial_rows import row

from dexgrasp.evaluation.report.tables import render_summary
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.evaluation.summary import summarise, summarise_agent
from dexgrasp_env.objects.catalogue import OBJECT_SETS


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
    found = summarise_agent(rows)["constraints"]
    distances = [d for r in rows for d in r["details"]["certificate"]["distances_cm"]]
    assert (found["grasps"], found["hold"]) == (63, 63)
    assert found["distance_cm"]["median"] == pytest.approx(np.median(distances))
    violation = max(0, -0.68 - min(distances), max(distances) + 0.32)
    assert found["distance_cm"]["max_violation"] == pytest.approx(violation)
    assert set(found["by_set"]) == {"seen", "familiar", "novel", "meshes"}
    assert summarise_agent([row()])["constraints"] == {}


def test_what_is_there_is_summed_up_beside_the_paper():
    settings = EvaluationSettings(("bilevel", "hardcoded"), ("soda",), trials=2)
    rows = [
        row("bilevel", trial=0, success=True),
        row("bilevel", trial=1, success=True),
        row("hardcoded", trial=0),
    ]
    summary = summarise(settings, rows)
    assert summary["complete"] is False
    text = render_summary(summary)
    assert "2/2 (6/6)" in text  # ours (the paper's)
    assert "95.8 % 23/24" not in text.splitlines()[2]
    assert "dropped" in text
