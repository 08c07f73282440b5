"""Statistics: coverage of intervals by simulation, published values, exact tests."""

import numpy as np
import pytest
from scipy.stats import norm
from tables import table
from trial_rows import row

from dexgrasp.evaluation.statistics import (
    object_interval,
    paired_comparison,
    wilson_interval,
)
from dexgrasp.evaluation.summary import count, protocol_counts


def test_wilson_interval_against_published_values():
    # Newcombe (1998), table I, method 3: 81/263, 15/148, 0/20, 1/29.
    for k, n, low, high in table("wilson"):
        assert wilson_interval(k, n) == pytest.approx((low, high), abs=5e-5)
    assert wilson_interval(5, 5)[1] == 1.0
    assert wilson_interval(0, 0) == (0.0, 1.0)
    with pytest.raises(ValueError, match="3 successes"):
        wilson_interval(3, 2)


DRAWN = 0.01
"""Standard error of a share of 5 % of 600 draws."""


def drawn(rng, rates, units, met=1, shared=0.6):
    """Return outcomes of two agents: a share of what decides a trial is the unit's, a third of that for both alike."""
    common, own, rest = (rng.standard_normal((units, *shape)) for shape in ((1, 1), (1, 2), (met, 2)))
    felt = np.sqrt(shared / 3) * common + np.sqrt(shared * 2 / 3) * own + np.sqrt(1 - shared) * rest
    won = (felt < norm.ppf(rates)).tolist()
    return [(k, *pair) for k in range(units) for pair in won[k]]


@pytest.mark.parametrize(("units", "met"), [(60, 1), (30, 4), (60, 5)])
@pytest.mark.parametrize("rate", [0.5, 0.95])
def test_interval_and_test_of_a_comparison_err_as_they_say(units, met, rate):
    rng = np.random.default_rng(0)
    equal = [paired_comparison(drawn(rng, (rate, rate), units, met)) for _ in range(600)]
    assert np.mean([found["p_value"] <= 0.05 for found in equal]) <= 0.06 + DRAWN
    unequal = [paired_comparison(drawn(rng, (rate, rate - 0.1), units, met))["ci95"] for _ in range(300)]
    assert np.mean([low <= 0.1 <= high for low, high in unequal]) >= 0.93 - DRAWN


def test_a_comparison_says_one_thing():
    """Two equals by rate, of which one loses whole scenes and the other one condition of many."""
    lumpy = [(i, i >= 6, not (6 <= i < 66 and k == i % 10)) for i in range(120) for k in range(10)]
    assert paired_comparison(lumpy)["p_value"] > 0.9
    rng = np.random.default_rng(3)
    for rate in (0.3, 0.7, 0.9):
        found = paired_comparison(drawn(rng, (0.9, rate), 25, 3))
        low, high = found["ci95"]
        assert (found["p_value"] < 0.05) == (not low <= 0.0 <= high)
    assert paired_comparison([(0, True, True), (1, False, False)])["p_value"] == pytest.approx(1.0)
    assert paired_comparison((k, True, False) for k in range(5000))["p_value"] < 1e-12


@pytest.mark.parametrize("mean", [0.8, 0.9, 0.97, 0.995])
def test_object_interval_covers_new_objects_and_wilson_does_not(mean):
    """Objects differ by 0.7 standard deviations of what decides a trial."""
    rng, by_object, by_trial = np.random.default_rng(1), [], []
    for _ in range(300):
        rates = norm.cdf(norm.ppf(mean) * np.hypot(1.0, 0.7) + 0.7 * rng.standard_normal(20))
        k = rng.binomial(30, rates)
        low, high = object_interval({str(i): (int(k[i]), 30) for i in range(20)})
        by_object.append(low <= mean <= high)
        low, high = wilson_interval(int(k.sum()), 600)
        by_trial.append(low <= mean <= high)
    assert np.mean(by_object) >= 0.92
    assert np.mean(by_trial) < np.mean(by_object) - 0.03


def test_trials_of_a_scene_count_as_the_scene():
    """The same scenes under two conditions with the same outcomes say no more than under one."""
    rows = [row(trial=k, success=k < 126) for k in range(180)]
    alone = count(rows)["ci95"]
    assert alone == pytest.approx(wilson_interval(126, 180))
    assert count([*rows, *rows])["ci95"] == pytest.approx(alone)
    parts = protocol_counts({"pushed@0.5": rows, "pushed@1": rows})
    assert parts["pushed"]["ci95"] == pytest.approx(alone)
    solved = [row(trial=k, success=True) for k in range(180)]
    assert count([*solved, *solved])["ci95"] == pytest.approx(wilson_interval(180, 180))
