"""Parting of a recorded cloud: things found by `instances` that are not known to be two are joined, and doubt is said.

Holes, flying points and hidden sides tear a thing: its splinters lie along it, and what is hollow is seen as an outer
and an inner side that meet in a rim.
"""

from itertools import combinations

import numpy as np

from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.perception.cloud import Cloud, cells_of
from dexgrasp_env.perception.instances import Instances, longest_side, segment_instances
from dexgrasp_env.perception.plane import Plane

_TOUCH = 0.004  # m between points of things that touch
_ALONG, _BESIDE = 0.010, 0.5  # m from a larger thing within which so much of a splinter lies
_SMALL = 0.3  # of the larger thing's points that a splinter has at most
_RIM, _LOWEST = 0.15, 0.012  # of a thing's height, and m, that its rim is high
_WALL = 0.012  # m from the outline of a rim within which it lies
_ON_IT, _CLOSED = 0.85, 0.65  # share of a rim that lies on its outline; of that outline that is seen
_WIDEST, _NARROWEST = 0.26, 0.04  # m, of a rim
_SPREAD = 0.6  # of a hollow thing's outline that its rim encloses
_CELL = 0.004  # m, to which rims are thinned


def part_instances(cloud: Cloud, everything: Cloud, plane: Plane) -> Instances:
    """Tell the things in what stands on a table apart; join what is not known to be two.

    Args:
        cloud: what stands on the table.
        everything: the same with the table.
        plane: the table.
    """
    found = segment_instances(cloud, plane)
    labels = found.labels
    if len(found.doubts) > 1:
        labels = _with_rims(cloud.points, labels, plane)
        labels = _with_splinters(cloud.points, labels, plane)
    numbers, labels = np.unique(labels, return_inverse=True)
    return Instances(labels, tuple(found.doubts[k] for k in numbers))


def _with_rims(points: Array, labels: Index, plane: Plane) -> Index:
    heights = plane.heights(points)
    joined = True
    while joined:
        joined = False
        counts = np.bincount(labels)
        numbers = [k for k in np.argsort(-counts) if counts[k] >= 50]
        for i, j in combinations(numbers, 2):
            both = (labels == i) | (labels == j)
            if longest_side(points[both]) < _WIDEST and is_hollow(points[both], heights[both]):
                labels = np.where(labels == j, i, labels)
                joined = True
                break
    return labels


def is_hollow(points: Array, heights: Array) -> bool:
    """Return true for points (N, 3) m, as high over the table, that end in a rim around what is lower."""
    from scipy.spatial import ConvexHull, cKDTree

    top = np.quantile(heights, 0.98)
    rim = points[heights > top - max(_LOWEST, _RIM * top), :2]
    rim = rim[np.unique(cells_of(rim, _CELL), return_index=True)[1]]
    if len(rim) < 10 or np.ptp(rim, axis=0).min() < _NARROWEST:
        return False
    around = ConvexHull(rim)
    if around.volume < _SPREAD * ConvexHull(points[:, :2]).volume:
        return False
    on_it = -(rim @ around.equations[:, :2].T + around.equations[:, 2]).max(1) < _WALL
    corners = rim[around.vertices]
    steps = np.linspace(0.0, 1.0, 16)[:-1, None, None]
    outline = (corners + steps * (np.roll(corners, -1, axis=0) - corners)).reshape(-1, 2)
    length = np.tile(np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1), 15)
    seen = cKDTree(rim[on_it]).query(outline)[0] < _WALL
    return bool(on_it.mean() > _ON_IT and length[seen].sum() > _CLOSED * length.sum())


def _with_splinters(points: Array, labels: Index, plane: Plane) -> Index:
    from scipy.spatial import cKDTree

    counts = np.bincount(labels)
    for k in np.argsort(counts):
        mine = labels == k
        larger = np.bincount(labels)[labels] > mine.sum() / _SMALL
        if not mine.any() or not larger.any():
            continue
        distance, nearest = cKDTree(points[larger]).query(points[mine])
        if np.quantile(distance, 0.1) < _TOUCH and (distance < _ALONG).mean() > _BESIDE:
            labels[mine] = np.bincount(labels[larger][nearest]).argmax()
    return labels
