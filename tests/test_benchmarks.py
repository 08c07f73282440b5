"""Every benchmark runs once, as `dexgrasp benchmark NAME --quick` does, and gives finite figures."""

import math
from types import SimpleNamespace

import pytest
from refusals import refused

from dexgrasp.cli.benchmarks import proposals
from dexgrasp.cli.benchmarks.registry import BENCHMARKS, run_benchmark


def numbers(figures):
    """Yield every number of nested dictionaries and lists."""
    if isinstance(figures, dict | list):
        for value in figures.values() if isinstance(figures, dict) else figures:
            yield from numbers(value)
    elif isinstance(figures, int | float):
        yield figures


@pytest.mark.parametrize("name", BENCHMARKS)
def test_it_runs_and_gives_finite_figures(name):
    found = list(numbers(run_benchmark(name, quick=True)))
    assert len(found) > 3
    assert all(math.isfinite(value) for value in found)


def test_an_unknown_one_is_named():
    with refused("stepping"):
        run_benchmark("stapping", quick=True)


def test_a_source_that_fails_is_not_the_cheaper_for_it():
    """Two sources that take as long for every attempt, of which one gives up half of them."""
    log = SimpleNamespace(tried=2, seconds={})
    plan = SimpleNamespace(log=log, grasps=[])
    sure = [proposals.Attempt(str(k), plan, 1.0, True) for k in range(8)]
    unsure = [attempt._replace(verified=k % 2 == 0) for k, attempt in enumerate(sure)]
    one, other = proposals._figures(sure), proposals._figures(unsure)
    assert (one["tried_each"], one["seconds_each"]) == (2.0, 1.0)
    assert (other["tried_each"], other["seconds_each"]) == (4.0, 2.0)
    assert proposals._figures([a._replace(verified=False) for a in sure])["seconds_each"] is None


def test_seeds_of_a_scene_tell_less_than_scenes(monkeypatch):
    monkeypatch.setattr(proposals, "_between", lambda a, b: (0.0, 0.0))  # there are no grasps here
    plan = SimpleNamespace(log=SimpleNamespace(tried=2, seconds={}), grasps=[])
    alone = [proposals.Attempt(str(k), plan, 1.0, k % 4 == 0) for k in range(16)]
    shared = [
        attempt._replace(scene=str(k % 4)) for k, attempt in enumerate(alone)
    ]  # one of four scenes, always
    (low, high), (lower, higher) = (proposals._figures(own)["verified_ci95"] for own in (alone, shared))
    assert lower < low < high < higher
