"""Every benchmark runs once, as `dexgrasp benchmark NAME --quick` does, and gives finite figures."""

import math

import pytest

from dexgrasp.cli.benchmark import BENCHMARKS, Benchmark


def numbers(figures):
    """Yield every number of nested dictionaries and lists."""
    if isinstance(figures, dict | list):
        for value in figures.values() if isinstance(figures, dict) else figures:
            yield from numbers(value)
    elif isinstance(figures, int | float):
        yield figures


@pytest.mark.parametrize("name", BENCHMARKS)
def test_it_runs_and_gives_finite_figures(name):
    found = list(numbers(Benchmark(name=name, quick=True).run().content["figures"]))
    assert len(found) > 3
    assert all(math.isfinite(value) for value in found)
