"""Loops over points in numba; import inside functions only, so that perception imports without it."""

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.compiled import njit, wide


@wide
def farthest_points(points: Array, count: int, first: int) -> Index:
    """Return `count` indices, each the farthest from all before it (Gonzalez 1985)."""
    chosen = np.empty(count, np.int64)
    chosen[0] = first
    x, y, z = points[:, 0].copy(), points[:, 1].copy(), points[:, 2].copy()
    nearest = np.full(len(points), np.inf)
    bits = nearest.view(np.int64)  # which sort as numbers that are not negative do, several at once
    for k in range(1, count):
        last, best, pick = chosen[k - 1], np.int64(0), 0
        for i in range(len(points)):
            dx, dy, dz = x[i] - x[last], y[i] - y[last], z[i] - z[last]
            d = dx * dx + dy * dy + dz * dz
            nearest[i] = d if d < nearest[i] else nearest[i]
        for i in range(len(points)):
            best = max(best, bits[i])
        while bits[pick] != best:
            pick += 1
        chosen[k] = pick
    return chosen


@njit
def first_of_each(numbers: Index) -> Index:
    """Return the indices, in order, at which each of the numbers (M,) stands first."""
    size, count, kept = 2, 0, np.empty(len(numbers), np.int64)
    while size < 2 * len(numbers):
        size *= 2
    table = np.full(
        size, -1
    )  # of indices, by the numbers' hashes (Fibonacci's); what is taken is looked for beside
    for i in range(len(numbers)):
        at = (numbers[i] * 0x9E3779B1 >> 15) & (size - 1)
        while table[at] >= 0 and numbers[table[at]] != numbers[i]:
            at = (at + 1) & (size - 1)
        if table[at] < 0:
            table[at] = kept[count] = i
            count += 1
    return kept[:count]


@njit
def pairs_within(
    queries: Array, points: Array, reach: float
) -> tuple[NDArray[np.int32], NDArray[np.int32], Array]:
    """Return the pairs of queries (Q, 3) m and points (M, 3) m that are at most `reach` m apart, by their points.

    Returns:
        The query of each pair (P,), where the pairs of each point begin (M + 1,), and squared distances (P,).
    """
    low, high, size = np.empty(3), np.empty(3), np.empty(3, np.int64)
    for a in range(3):
        low[a], high[a] = queries[:, a].min(), queries[:, a].max()
    # m, of the cells that queries are sorted into; a little more, so that rounding takes no pair beyond the next cell
    side = max(1.001 * reach, 0.01 * (high - low).max())
    for a in range(3):
        size[a] = int((high[a] - low[a]) / side) + 1
    cell, first = np.empty(len(queries), np.int64), np.zeros(size[0] * size[1] * size[2] + 1, np.int64)
    for i in range(len(queries)):
        cell[i] = 0
        for a in range(3):
            cell[i] = cell[i] * size[a] + int((queries[i, a] - low[a]) / side)
        first[cell[i] + 1] += 1
    first = np.cumsum(first)
    order = np.argsort(cell, kind="mergesort")
    sorted_queries = queries[order]
    room = len(queries) + 32 * len(points)  # of pairs, doubled where there are more
    within, away, count = np.empty(room, np.int32), np.empty(room), 0
    begins, least, last = np.zeros(len(points) + 1, np.int32), np.empty(3, np.int64), np.empty(3, np.int64)
    for j in range(len(points)):
        for a in range(3):
            at = min(max((points[j, a] - low[a]) / side, -2.0), size[a] + 1.0)
            least[a], last[a] = max(int(np.floor(at)) - 1, 0), min(int(np.floor(at)) + 1, size[a] - 1)
        x, y, z = points[j]
        for row in range(least[0], last[0] + 1):
            for line in range(row * size[1] + least[1], row * size[1] + last[1] + 1):
                if least[2] > last[2]:
                    continue
                run = range(first[line * size[2] + least[2]], first[line * size[2] + last[2] + 1])
                if count + len(run) > len(within):
                    within, away = np.append(within, within), np.append(away, away)
                for k in run:
                    dx, dy, dz = sorted_queries[k, 0] - x, sorted_queries[k, 1] - y, sorted_queries[k, 2] - z
                    within[count], away[count] = order[k], dx * dx + dy * dy + dz * dz
                    count += away[count] <= reach * reach  # without a branch: three times as fast
        begins[j + 1] = count
    return within[:count], begins, away[:count]
