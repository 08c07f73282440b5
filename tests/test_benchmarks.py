"""Every benchmark runs once, as `dexgrasp benchmark NAME --quick` does, and gives finite figures."""

import math

import pytest
from refusals import refused

from dexgrasp.cli.benchmark import BENCHMARKS, run_benchmark


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
        run_benchmark("stapping")
