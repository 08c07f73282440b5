"""Loops over points in numba; import inside functions only, so that perception imports without it."""

from typing import NamedTuple

import numpy as np

from dexgrasp_env.arrays import Array, Index, Mask
from dexgrasp_env.compiled import leaf, njit, wide


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


class _Grid(NamedTuple):
    """Points in cells: themselves (M, 3) m, cell after cell, which they were (M,), where those of each cell begin; a
    corner of the cells (3,) m, their side, m, and how many they are (3,).
    """

    points: Array
    rows: Index
    first: Index
    low: Array
    side: float
    size: Index


@njit
def _in_cells(points: Array, side: float) -> _Grid:
    """Return points (M, 3) m in cells `side` m wide, or wider, so that a row has no more than a hundred."""
    low, high, size = np.empty(3), np.empty(3), np.empty(3, np.int64)
    for a in range(3):
        low[a], high[a] = points[:, a].min(), points[:, a].max()
    side = max(side, 0.01 * (high - low).max())
    for a in range(3):
        size[a] = int((high[a] - low[a]) / side) + 1
    cell, first = np.zeros(len(points), np.int64), np.zeros(size[0] * size[1] * size[2] + 2, np.int64)
    for i in range(len(points)):
        for a in range(3):
            cell[i] = cell[i] * size[a] + int((points[i, a] - low[a]) / side)
        first[cell[i] + 2] += 1
    first, rows = np.cumsum(first), np.empty(len(points), np.int64)
    for i in range(len(points)):
        rows[first[cell[i] + 1]] = i
        first[cell[i] + 1] += 1
    return _Grid(points[rows], rows, first, low, side, size)


@leaf
def _near(grid: _Grid, place: Array, reach: float, found: Index, limits: Index, enough: int) -> int:
    """Write which points of a grid are at most `reach` m from a place (3,) m, and return how many they are.

    Args:
        found: that are written.
        limits: (3, 2) that are written over.
        enough: after so many the others may be left out.
    """
    count, points, size = 0, grid.points, grid.size
    for a in range(3):
        for end in range(2):
            cell = (place[a] - grid.low[a] + (2 * end - 1) * reach) / grid.side
            limits[a, end] = int(min(max(cell, 0.0), size[a] - 0.5))
    x, y, z = place
    for row in range(limits[0, 0], limits[0, 1] + 1):
        for line in range(row * size[1] + limits[1, 0], row * size[1] + limits[1, 1] + 1):
            run = grid.first[line * size[2] + limits[2, 0] : line * size[2] + limits[2, 1] + 2]
            for k in range(run[0], run[-1]):
                dx, dy, dz = points[k, 0] - x, points[k, 1] - y, points[k, 2] - z
                found[count] = k
                count += dx * dx + dy * dy + dz * dz <= reach * reach  # without a branch: three times as fast
            if count >= enough:
                return count
    return count


@njit
def has_near(queries: Array, points: Array, reach: float, least: int) -> Mask:
    """Return which queries (Q, 3) m have at least so many of points (M, 3) m at most `reach` m away."""
    grid, has = _in_cells(points, reach), np.empty(len(queries), np.bool_)
    found, limits = np.empty(len(points) + 1, np.int64), np.empty((3, 2), np.int64)
    for i in range(len(queries)):
        has[i] = _near(grid, queries[i], reach, found, limits, least) >= least
    return has


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
    grid, off, mean, covariance = _in_cells(points, radius), np.empty(3), np.empty(3), np.empty((3, 3))
    found, limits = np.empty(len(points) + 1, np.int64), np.empty((3, 2), np.int64)
    centres, normals, residuals = queries.copy(), np.zeros(queries.shape), np.zeros(len(queries))
    for i in range(len(queries)):
        for reach in (radius, 2.0 * radius):
            count = _near(grid, queries[i], reach, found, limits, len(points))
            if count >= least:
                break
        if count < 3:
            continue
        total, mean[:], covariance[:] = 0.0, 0.0, 0.0
        for k in found[:count]:
            away = 0.0
            for a in range(3):
                off[a] = grid.points[k, a] - queries[i, a]
                away += off[a] * off[a]
            weight = weights[grid.rows[k]] * np.exp(-2.0 * away / (reach * reach))
            total += weight
            for a in range(3):
                mean[a] += weight * off[a]
                for b in range(a, 3):
                    covariance[a, b] += weight * off[a] * off[b]
        mean /= total
        for a in range(3):
            for b in range(a, 3):
                covariance[a, b] = covariance[a, b] / total - mean[a] * mean[b]
        centres[i] += mean
        residuals[i] = np.sqrt(max(_least_across(covariance, normals[i]), 0.0))
    return centres, normals, residuals


@leaf
def _least_across(covariance: Array, way: Array) -> float:
    """Return the least eigenvalue of a covariance (3, 3), of its upper half, and write its eigenvector into `way` (3,).

    The eigenvector stays as it is where there are two such, as of points in a row.
    """
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = covariance
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy  # cofactors
    d, e, f = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    trace, value = xx + yy + zz, 0.0
    for _ in range(60):  # Newton's steps: from below they end at the characteristic polynomial's least root
        slope = a + d + f - value * (2.0 * trace - 3.0 * value)
        left = xx * a + xy * b + xz * c - value * (a + d + f - value * (trace - value))
        step = left / slope if slope > 0.0 else 0.0
        value += step
        if step < 1e-14 * trace:
            break
    # The columns of the adjugate without the eigenvalue are the eigenvector, of some length.
    a, b, c = a + value * (value - yy - zz), b + value * xy, c + value * xz
    d, e, f = d + value * (value - xx - zz), e + value * yz, f + value * (value - xx - yy)
    x, y, z = (a, b, c) if a >= max(d, f) else (b, d, e) if d >= f else (c, e, f)
    length = np.sqrt(x * x + y * y + z * z)
    if length > 0.0:
        way[0], way[1], way[2] = x / length, y / length, z / length
    return value
