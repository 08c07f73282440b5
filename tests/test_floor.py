"""The rates of success do not fall: 40 frozen scenes, played by the planner and by the baseline."""

from collections import Counter

import pytest

from dexgrasp.evaluation.evaluate import evaluate
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.evaluation.store import read_rows
from dexgrasp.runs.pool import Backend
from dexgrasp_env.cores import usable_cores

LEAST = {
    ("bilevel", "lift"): 19, ("bilevel", "pushed@1"): 16,
    ("hardcoded", "lift"): 17, ("hardcoded", "pushed@1"): 9,
}  # fmt: skip
"""Successes of 20. What 0.2.0 reaches is 20, 18, 19 and 12; another processor's rounding may cost one or two."""


@pytest.mark.slow
def test_as_many_of_the_frozen_scenes_as_ever_end_in_success(tmp_path):
    agents, protocols = (tuple(dict.fromkeys(names)) for names in zip(*LEAST, strict=True))
    settings = EvaluationSettings.of(agents, ["all20"], trials=1, seed=7, protocols=protocols)
    evaluate(settings, tmp_path, backend=Backend(workers=usable_cores()))
    won = Counter((row["agent"], row["protocol"]) for row in read_rows(tmp_path) if row["success"])
    assert not {case: won[case] for case, least in LEAST.items() if won[case] < least}
