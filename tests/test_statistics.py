"""Statistics: coverage of intervals by simulation, published values, exact tests."""

import numpy as np
import pytest
from trial_rows import row

from dexgrasp.evaluation.statistics import (
    object_difference_interval,
    object_interval,
    paired_comparison,
    paired_difference_interval,
    wilson_interval,
)
from dexgrasp.evaluation.summary import count, protocol_counts


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


def test_scenes_that_are_met_once_are_tested_by_mcnemar():
    found = paired_comparison((i, i < 9, 8 <= i < 10) for i in range(20))
    assert [found[k] for k in ("both", "only_a", "only_b", "neither")] == [1, 8, 1, 10]
    assert found["p_value"] == pytest.approx(2 * (1 + 9) / 2**9)
    assert paired_comparison([(0, True, True), (1, False, False)])["p_value"] == 1.0


def test_paired_difference_covers_as_it_says():
    rng, inside = np.random.default_rng(0), []
    shares = np.array([0.80, 0.12, 0.04, 0.04])  # both, only a, only b, neither: difference 0.08
    for both, only_a, only_b, neither in rng.multinomial(60, shares, 500).tolist():
        low, high = paired_difference_interval(both, only_a, only_b, neither)
        inside.append(low <= 0.08 <= high)
    assert 0.92 < np.mean(inside) < 0.99


def test_paired_difference_at_the_ends():
    assert paired_difference_interval(0, 0, 0, 0) == (-1.0, 1.0)
    low, high = paired_difference_interval(20, 0, 0, 0)
    assert -0.2 < low < 0.0 < high < 0.2
    a, b = paired_difference_interval(10, 6, 1, 3), paired_difference_interval(10, 1, 6, 3)
    assert a == pytest.approx((-b[1], -b[0]))


def test_object_interval_covers_new_objects_and_wilson_does_not():
    """Objects differ (a beta distribution), trials on one object go together."""
    rng, truth = np.random.default_rng(1), 0.8
    by_object, by_trial = [], []
    for _ in range(80):
        rates = rng.beta(1.6, 0.4, 20)
        k = rng.binomial(10, rates)
        low, high = object_interval({str(i): (int(k[i]), 10) for i in range(20)})
        by_object.append(low <= truth <= high)
        low, high = wilson_interval(int(k.sum()), 200)
        by_trial.append(low <= truth <= high)
    assert np.mean(by_object) > 0.87
    assert np.mean(by_trial) < 0.80


def test_object_interval_where_all_objects_agree():
    assert object_interval({str(i): (6, 6) for i in range(20)}) == wilson_interval(20, 20)
    assert object_interval({"a": (1, 3)}) == wilson_interval(0, 1)
    assert object_interval({}) == (0.0, 1.0)
    assert object_difference_interval({"a": (1, 2)}, {"a": (2, 2)}) == (-1.0, 1.0)


def test_object_difference_sees_what_one_object_cannot_show():
    a = {str(i): (5, 5) for i in range(10)}
    one_bad = {**a, "0": (0, 5)}
    low, high = object_difference_interval(a, one_bad)
    assert low == 0.0  # one object alone: new objects may show no difference
    assert high > 0.2
    low, high = object_difference_interval(a, {k: (2, 5) for k in a})  # ten objects, each as far apart
    assert 0.2 < low < 0.6 < high < 0.9
    assert object_difference_interval(a, a) == pytest.approx(paired_difference_interval(10, 0, 0, 0))


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


def test_the_interval_of_a_difference_covers_where_scenes_are_met_often():
    rng, inside = np.random.default_rng(4), []
    for _ in range(200):
        scene = rng.random(60)[:, None]  # how hard it is, for both and under all of five conditions
        a, b = scene + 0.1 * rng.random((60, 5)) < 0.85, scene + 0.1 * rng.random((60, 5)) < 0.75
        found = paired_comparison(
            (k, *pair) for k in range(60) for pair in zip(a[k].tolist(), b[k].tolist(), strict=True)
        )
        inside.append(found["ci95"][0] <= 0.1 <= found["ci95"][1])
    assert 0.9 < np.mean(inside) <= 1.0
