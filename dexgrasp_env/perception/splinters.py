"""Splinters of recorded things: holes, flying points and hidden sides tear what is one, and its pieces are joined.

Splinters lie along a thing or hang beside it; what is hollow is seen as an outer and an inner side that meet in a rim.
"""

from itertools import combinations
from typing import Any

import numpy as np

from dexgrasp_env.arrays import Array, Index, Mask
from dexgrasp_env.perception.cloud import cells_of
from dexgrasp_env.perception.hulls import THIN, beyond, hull_of, is_hollow, longest_side
from dexgrasp_env.perception.instances import LEAST_POINTS


def with_rims(points: Array, labels: Index) -> Index:
    """Return labels (N,) in which the outer and the inner side of a hollow thing are one."""
    joined = True
    while joined:
        joined = False
        counts = np.bincount(labels)
        numbers = [k for k in np.argsort(-counts) if counts[k] >= LEAST_POINTS]
        for i, j in combinations(numbers, 2):
            both = points[(labels == i) | (labels == j)]
            if longest_side(both) < 0.26 and is_hollow(both):
                labels = np.where(labels == j, i, labels)
                joined = True
                break
    return labels


def with_splinters(points: Array, labels: Index, everything: Array) -> Index:
    """Return labels (N,) in which what is no thing by itself is of a larger one.

    Such are small things along it, things in the air beside it, and the inner side of its walls.
    """
    from scipy.spatial import cKDTree

    for k in np.argsort(np.bincount(labels)):
        mine = labels == k
        if not mine.any():
            continue
        if (whole := _lined(points, labels, mine)) is not None:
            labels[mine] = whole
            continue
        larger = np.bincount(labels)[labels] > mine.sum() / 0.3  # of its points
        if not larger.any():
            continue
        distance, nearest = cKDTree(points[larger]).query(points[mine])
        along = np.quantile(distance, 0.1) < THIN and (distance < 0.010).mean() > 0.5
        size, far = longest_side(points[mine]), distance.min()
        hangs = points[mine, 2].min() > 0.02 and (
            (size < 0.10 and far < 0.025)
            or (size < 0.04 and far < 0.05)
            or (far < 0.05 and in_the_air(points[mine], everything))
        )
        if along or hangs:
            labels[mine] = np.bincount(labels[larger][nearest]).argmax()
    return labels


def in_the_air(points: Array, everything: Array) -> bool:
    """Return true for points (N, 3) m below which others (M, 3) m are seen: what stands hides what is under it."""
    low = points[:, 2].min()
    below = everything[everything[:, 2] < low - 0.010]
    cells = cells_of(np.concatenate([points, below])[:, :2], 2.0 * THIN)
    own, others = np.split(cells, [len(points)])
    return bool(low > 0.02 and np.isin(np.unique(own), others).mean() > 0.3)


def _lined(points: Array, labels: Index, mine: Mask) -> int | None:
    """Return the larger thing whose walls a thing (N,) lines on the inside, None where there is none."""
    counts = np.bincount(labels)
    for k in np.argsort(-counts):
        if counts[k] <= mine.sum():
            return None
        other = points[labels == k]
        hulls = (hull_of(other), hull_of(np.concatenate([other, other * [1.0, 1.0, 0.0]])))
        if any(hull is not None and _lies_in_walls(hull, points[mine]) for hull in hulls):
            return int(k)
    return None


def _lies_in_walls(hull: Any, points: Array) -> bool:
    """Return true for points (N, 3) m in a hull of which most lie just behind its sides or its bottom."""
    sides = hull.equations[hull.equations[:, 2] < 0.5]
    behind = (points @ sides[:, :-1].T + sides[:, -1]).max(1)
    return bool((beyond(hull, points) < 0.003).mean() > 0.9 and (behind > -0.010).mean() > 0.8)
