"""A fixed number of points out of any number."""

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from dexgrasp_env.poses import Array


def downsample(points: Array, count: int, rng: Generator, pool: int = 3) -> NDArray[np.int64]:
    """Return the indices of an even subset: farthest point sampling in a random pool of `pool * count`
    points.

    Args:
        points: (M, 3) m.
        count: how many are wanted.
        rng: draws the pool and the first point.
        pool: how many candidates to a chosen point, at most; bounds the cost.

    Returns:
        (min(M, count),) indices without repetition; all of them, in order, when there are no more than
        wanted.
    """
    if len(points) <= count:
        return np.arange(len(points))
    candidates = np.arange(len(points))
    if len(points) > pool * count:
        candidates = np.sort(rng.choice(len(points), pool * count, replace=False))
    from dexgrasp_env.perception.kernels import farthest_points

    first = int(rng.integers(len(candidates)))
    return candidates[farthest_points(np.ascontiguousarray(points[candidates]), count, first)]


def pad(rows: NDArray, count: int) -> NDArray:
    """Return `rows` (M, ...) as (count, ...), zeros after the last."""
    padded = np.zeros((count, *rows.shape[1:]), rows.dtype)
    padded[: len(rows)] = rows[:count]
    return padded
