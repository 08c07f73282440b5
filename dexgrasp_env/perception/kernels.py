"""Neighbour loops in numba; import inside functions only, so that perception imports without it."""

from typing import NamedTuple

import numpy as np

from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.compiled import njit


class Grid(NamedTuple):
    """Points (M, 3) sorted into cubic cells.

    Attributes:
        points: (M, 3) m.
        size: of the cells, m.
        shape: (3,) numbers of cells.
        low: (3,) m, its low corner.
        order: (M,) of the points by cell.
        start: where each cell starts in that order.
    """

    points: Array
    size: float
    shape: Index
    low: Array
    order: Index
    start: Index


@njit
def cell_grid(points: Array, size: float) -> Grid:
    """Sort points into cubic cells of `size` metres."""
    n = len(points)
    low = np.empty(3)
    shape = np.empty(3, np.int64)
    for a in range(3):
        low[a] = points[:, a].min()
        shape[a] = int((points[:, a].max() - low[a]) / size) + 1
    cells = np.empty(n, np.int64)
    start = np.zeros(shape[0] * shape[1] * shape[2] + 1, np.int64)
    for i in range(n):
        c = 0
        for a in range(3):
            c = c * shape[a] + int((points[i, a] - low[a]) / size)
        cells[i] = c
        start[c + 1] += 1
    for c in range(len(start) - 1):
        start[c + 1] += start[c]
    fill = start.copy()
    order = np.empty(n, np.int64)
    for i in range(n):
        order[fill[cells[i]]] = i
        fill[cells[i]] += 1
    return Grid(points, size, shape, low, order, start)


@njit
def neighbours(q: Array, grid: Grid, out: Index) -> int:
    """Write into `out` the points within the size of a cell of q; return their number."""
    points, radius, shape, low, order, start = grid
    found = 0
    c = np.empty(3, np.int64)
    for a in range(3):
        c[a] = int(np.floor((q[a] - low[a]) / radius))
    for x in range(max(c[0] - 1, 0), min(c[0] + 2, shape[0])):
        for y in range(max(c[1] - 1, 0), min(c[1] + 2, shape[1])):
            row = (x * shape[1] + y) * shape[2]
            first, last = row + max(c[2] - 1, 0), row + min(c[2] + 2, shape[2])
            if last <= first:
                continue
            for s in range(start[first], start[last]):
                i = order[s]
                d = 0.0
                for a in range(3):
                    d += (points[i, a] - q[a]) ** 2
                if d <= radius * radius and found < len(out):
                    out[found] = i
                    found += 1
    return found


@njit
def count_neighbours(points: Array, radius: float) -> Index:
    """Return how many other points lie within `radius` of each."""
    grid, out = cell_grid(points, radius), np.empty(len(points), np.int64)
    counts = np.empty(len(points), np.int64)
    for i in range(len(points)):
        counts[i] = neighbours(points[i], grid, out) - 1
    return counts


@njit
def cluster(points: Array, radius: float) -> Index:
    """Return a label for each point; points within `radius` of each other share it."""
    n, grid = len(points), cell_grid(points, radius)
    labels = np.full(n, -1, np.int64)
    stack = np.empty(n, np.int64)
    out = np.empty(n, np.int64)
    label = 0
    for seed in range(n):
        if labels[seed] >= 0:
            continue
        labels[seed] = label
        stack[0] = seed
        top = 1
        while top > 0:
            top -= 1
            found = neighbours(points[stack[top]], grid, out)
            for s in range(found):
                if labels[out[s]] < 0:
                    labels[out[s]] = label
                    stack[top] = out[s]
                    top += 1
        label += 1
    return labels


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


@njit
def local_planes(
    queries: Array, points: Array, weights: Array, radius: float, least: int
) -> tuple[Array, Array, Array]:
    """Fit a plane to the weighted neighbourhood of each query.

    Args:
        queries: (Q, 3).
        points: (M, 3).
        weights: (M,) confidence of each point; a Gaussian of the distance multiplies it.
        radius: of the neighbourhood, metres; doubled once where fewer than `least` points are in it.
        least: fewest points of a fit.

    Returns:
        Centroids (Q, 3), unit normals (Q, 3; zero where no fit), RMS residuals (Q,).
    """
    near, wide = cell_grid(points, radius), cell_grid(points, 2.0 * radius)
    n = len(queries)
    centres, normals, residuals = queries.copy(), np.zeros((n, 3)), np.zeros(n)
    out = np.empty(len(points), np.int64)
    for k in range(n):
        r = radius
        found = neighbours(queries[k], near, out)
        if found < least:
            r = 2.0 * radius
            found = neighbours(queries[k], wide, out)
        if found < 3:
            continue
        total = 0.0
        mean = np.zeros(3)
        w = np.empty(found)
        for s in range(found):
            d = 0.0
            for a in range(3):
                d += (points[out[s], a] - queries[k, a]) ** 2
            w[s] = weights[out[s]] * np.exp(-2.0 * d / (r * r))
            total += w[s]
            for a in range(3):
                mean[a] += w[s] * points[out[s], a]
        mean /= total
        cov = np.zeros((3, 3))
        for s in range(found):
            for a in range(3):
                for b in range(a + 1):
                    cov[a, b] += w[s] * (points[out[s], a] - mean[a]) * (points[out[s], b] - mean[b])
        for a in range(3):
            for b in range(a):
                cov[b, a] = cov[a, b]
        values, vectors = np.linalg.eigh(cov / total)
        centres[k] = mean
        normals[k] = vectors[:, 0]
        residuals[k] = np.sqrt(max(values[0], 0.0))
    return centres, normals, residuals
