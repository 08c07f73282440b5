"""Timing of calls, and statistics of repeated figures."""

import gc
import time
import timeit
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import wraps
from typing import Any
from unittest.mock import patch

import numpy as np

from dexgrasp_env.arrays import Array, Fields


def seconds_of(call: Callable[[], object], repeats: int) -> Array:
    """Return the wall time (repeats,) [s] of a call, one after another, garbage collected as ever."""
    return np.array(timeit.repeat(call, gc.enable, number=1, repeat=repeats))


@contextmanager
def clocks(*calls: tuple[Any, str]) -> Iterator[dict[str, list[float]]]:
    """Collect the wall time [s] of every call of some functions, by name, each of a module, class or object."""
    seconds: dict[str, list[float]] = {name: [] for _, name in calls}

    def timed(call: Callable[..., object], own: list[float]) -> Callable[..., object]:
        """Return the call, noting in `own` how long each took."""

        @wraps(call)
        def run(*args: Any, **kwargs: Any) -> object:
            """Do what is timed, and note the time even where it fails."""
            start = time.perf_counter()
            try:
                return call(*args, **kwargs)
            finally:
                own.append(time.perf_counter() - start)

        return run

    with ExitStack() as stack:
        for owner, name in calls:
            stack.enter_context(patch.object(owner, name, timed(getattr(owner, name), seconds[name])))
        yield seconds


def spread_of(values: Sequence[float] | Array) -> Fields:
    """Return the median with its 95 % bootstrap interval, the 90th percentile and the most; {} without values."""
    if not len(values):
        return {}
    drawn = np.random.default_rng(0).choice(np.asarray(values, dtype=float), (2000, len(values)))
    return {
        "median": np.median(values),
        "ci95": np.quantile(np.median(drawn, axis=1), [0.025, 0.975]),
        "p90": np.quantile(values, 0.9),
        "max": np.max(values),
    }
