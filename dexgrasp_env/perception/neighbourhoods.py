"""Neighbourhoods of a cloud's points: clusters, gaps, spacing."""

from typing import Any

import numpy as np

from dexgrasp_env.arrays import Array, Index


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
    return np.asarray(_tree(others).query(points, distance_upper_bound=most)[0])


def spacing(points: Array) -> float:
    """Return the median distance, m, of points (N, 3) from the next one; of many, 2000 or so are asked."""
    few = points[:: max(1, len(points) // 2000)]
    return float(np.median(_tree(points).query(few, k=[2])[0]))


def _tree(points: Array) -> Any:
    """Return a tree of points (N, n) for few questions: it is made in half the time of scipy's own."""
    from scipy.spatial import cKDTree

    return cKDTree(points, balanced_tree=False, compact_nodes=False)
