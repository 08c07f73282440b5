"""How long calls take."""

import time
from collections.abc import Callable

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
