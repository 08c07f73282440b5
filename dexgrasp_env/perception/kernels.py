"""Farthest point sampling in numba; import inside functions only, so that perception imports without it."""

import numpy as np

from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.compiled import njit


@njit
def farthest_points(points: Array, count: int, first: int) -> Index:
    """Return `count` indices, each the farthest from all before it (Gonzalez 1985)."""
    chosen = np.empty(count, np.int64)
    chosen[0] = first
    nearest = np.full(len(points), np.inf)
    for k in range(1, count):
        last = chosen[k - 1]
        best = -1.0
        pick = 0
        for i in range(len(points)):
            d = 0.0
            for a in range(3):
                d += (points[i, a] - points[last, a]) ** 2
            if d < nearest[i]:
                nearest[i] = d
            if nearest[i] > best:
                best = nearest[i]
                pick = i
        chosen[k] = pick
    return chosen
