"""How long calls take, and how figures spread."""

import time
from collections.abc import Callable, Sequence

import numpy as np

from dexgrasp_env.arrays import Array


def seconds_of(call: Callable[[], object], repeats: int) -> Array:
    """Return the wall time (repeats,) [s] of a call, one after another."""
    times = np.empty(repeats)
    for k in range(repeats):
        start = time.perf_counter()
        call()
        times[k] = time.perf_counter() - start
    return times


def spread_of(values: Sequence[float] | Array) -> dict[str, float | list[float]]:
    """Return the median with its 95 % bootstrap interval, the 90th percentile and the most; {} without values."""
    if not len(values):
        return {}
    drawn = np.random.default_rng(0).choice(np.asarray(values, dtype=float), (2000, len(values)))
    return {
        "median": float(np.median(values)),
        "ci95": np.quantile(np.median(drawn, axis=1), [0.025, 0.975]).tolist(),
        "p90": float(np.quantile(values, 0.9)),
        "max": float(np.max(values)),
    }
