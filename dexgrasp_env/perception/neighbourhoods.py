"""Neighbourhoods of a cloud's points: clusters, local planes."""

import numpy as np

from dexgrasp_env.arrays import Array, Index

_AT_ONCE = 8192  # queries: the pairs of more would fill the memory
# Of a symmetric matrix's six entries, and which of these each of all nine is.
_ROW, _COLUMN, _WHOLE = [0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2], [0, 1, 3, 1, 2, 4, 3, 4, 5]


def linked(points: Array, step: float) -> Index:
    """Return a number for each point (M, 3), from 0 on in their order; those linked by steps of `step` m share it."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    tree, labels = cKDTree(points), np.zeros(len(points), np.int64)
    for length in (0.5 * step, step):  # most often all hang together by short steps, of which there are few
        ends = tree.query_pairs(length, output_type="ndarray").T
        links = coo_matrix((np.ones(ends.shape[1], bool), ends), shape=(len(points), len(points)))
        labels = connected_components(links, directed=False)[1].astype(np.int64)
        if not labels.any():
            break
    return labels


def gaps_between(points: Array, others: Array, most: float = np.inf) -> Array:
    """Return how far (N,) m points (N, n) lie from the nearest of others (M, n), infinity where that is `most` m."""
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(others).query(points, distance_upper_bound=most)[0])


def spacing(points: Array) -> float:
    """Return the median distance, m, of points (N, 3) from the next one; of many, 2000 or so are asked."""
    from scipy.spatial import cKDTree

    few = points[:: max(1, len(points) // 2000)]
    return float(np.median(cKDTree(points).query(few, k=[2])[0]))


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
    from scipy.sparse import csc_matrix

    from dexgrasp_env.perception.kernels import pairs_within

    x = points - points.mean(0)
    moments = np.column_stack([np.ones(len(x)), x, x[:, _ROW] * x[:, _COLUMN]])
    n = len(queries)
    sums, counts = np.zeros((n, 10)), np.zeros(n, np.int64)
    for start in range(0, n, _AT_ONCE):
        rows = np.arange(start, min(start + _AT_ONCE, n))
        for reach in (radius, 2.0 * radius):
            within, begins, away = pairs_within(queries[rows], points, reach)
            # In place: of half a million pairs new memory takes longer than figures.
            weight = np.sqrt(away, out=away)
            weight /= reach
            weight *= weight
            weight *= -2.0
            np.exp(weight, out=weight)
            weight *= np.repeat(weights, np.diff(begins))
            near = csc_matrix((weight, within, begins), shape=(len(rows), len(points)))
            sums[rows], counts[rows] = near @ moments, np.bincount(within, minlength=len(rows))
            rows = rows[counts[rows] < least]
            if not len(rows):
                break
    fit = counts >= 3
    mean, squares = sums[fit, 1:4] / sums[fit, :1], sums[fit, 4:] / sums[fit, :1]
    covariance = (squares - mean[:, _ROW] * mean[:, _COLUMN])[:, _WHOLE].reshape(-1, 3, 3)
    values, vectors = np.linalg.eigh(covariance)
    centres, normals, residuals = queries.copy(), np.zeros((n, 3)), np.zeros(n)
    centres[fit], normals[fit] = mean + points.mean(0), vectors[:, :, 0]
    residuals[fit] = np.sqrt(np.maximum(values[:, 0], 0.0))
    return centres, normals, residuals
