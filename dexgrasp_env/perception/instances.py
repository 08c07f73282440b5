"""Instance segmentation: things that stand close, told apart by gaps, creases and surfaces that face each other.

Points are thinned and gathered into patches. Patches are joined, the surest seam first, until what is left between
them looks like seams of two objects; a seam is judged by all pairs of points across it, so that one narrow bridge
joins nothing (after locally convex connected patches, Stein et al. 2014).
"""

import heapq
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, Index, Mask, unit
from dexgrasp_env.perception.cloud import Cloud, cells_of, dot, means_of, smooth
from dexgrasp_env.perception.hulls import corners_and_volume, longest_side, width_of
from dexgrasp_env.perception.neighbourhoods import linked, spacing
from dexgrasp_env.perception.plane import Plane

LEAST_POINTS, LEAST_EXTENT = 50, 0.02
"""Points, and m of the longest side of a box around them, from which on a part is an object."""
MOST_EXTENT = 0.35
"""m of the longest side: what is longer is a wall, a bin, furniture."""
_LINK = 2.45  # cells, across a seam
_STEP = 1.3  # cells from a level side at which it is looked what stands before and behind it


MAY_BE_TWO = "may be two objects, or a part of the next"


class Instances(NamedTuple):
    """The things in a cloud.

    Attributes:
        labels: (M,) numbers from 0 on.
        doubts: (K,) why a thing may be something else, for people; empty without doubt.
    """

    labels: Index
    doubts: tuple[str, ...]

    def with_marked(self, marked: Mask) -> tuple["Instances", int]:
        """Return it with the points of a mask (M,) as one more thing, which is beyond doubt, and its number."""
        number = len(self.doubts)
        return Instances(np.where(marked, number, self.labels), (*self.doubts, "")), number

    def objects(self, cloud: Cloud) -> list[int]:
        """Return the numbers of those things on the table that are objects, the largest first."""
        return objects_in(cloud.points, self.labels)


def objects_in(points: Array, labels: Index) -> list[int]:
    """Return the numbers, the largest first, of the things among points (N, 3) m of which each has a label (N,)."""
    counts = np.bincount(labels)
    found = [
        k
        for k in np.flatnonzero(counts >= LEAST_POINTS).tolist()
        if longest_side(points[labels == k]) >= LEAST_EXTENT and is_graspable(points[labels == k])
    ]
    return sorted(found, key=lambda k: -counts[k])


def is_graspable(points: Array) -> bool:
    """Return true for points (N, 3) m no larger than things to grasp, of which pans are longer than others."""
    side = longest_side(points)
    return side <= MOST_EXTENT or (side < 0.50 and width_of(points) < 0.22 and not _is_sheet(points))  # m


def segment_instances(cloud: Cloud, plane: Plane) -> Instances:
    """Tell the things in a cloud apart, table and robot being removed."""
    if len(cloud) < LEAST_POINTS:
        return Instances(np.zeros(len(cloud), np.int64), ("",))
    cell = _cell_of(cloud.points)
    points, normals = smooth(cloud, cloud, plane.rms, 0.008)
    _, which = np.unique(cells_of(points, cell), return_inverse=True)
    points, normals = means_of(which, points), unit(means_of(which, normals))
    if not np.ptp(cloud.views, axis=0).any():  # nobody knows who saw the points
        normals = _to_the_air(points, normals, cell)
    patches = _patches(points, normals, cell)
    seams = _seams(points, normals, patches, plane, cell)
    things, doubtful = _join(np.bincount(patches[which]), points, patches, *seams)
    things = things[patches[which]]
    labels = _with_walls(_with_crumbs(cloud.points, things), cloud, _LINK * cell)
    _, labels = np.unique(labels, return_inverse=True)
    biggest = [np.bincount(things[labels == k]).argmax() for k in range(labels.max() + 1)]
    return Instances(labels, tuple(MAY_BE_TWO if doubt else "" for doubt in doubtful[biggest]))


def _cell_of(points: Array) -> float:
    """Return the side, m, of the cells to which points are thinned: as small as they lie close."""
    return float(np.clip(1.2 * spacing(points), 0.0045, 0.006))


def _to_the_air(points: Array, normals: Array, cell: float) -> Array:
    """Return normals (N, 3) turned up, or where they are level away from what stands higher."""
    from scipy.ndimage import grey_closing

    squares = np.floor(points[:, :2] / cell).astype(int)
    low = squares.min(0) - 3
    heights = np.full(np.ptp(squares, axis=0) + 7, -np.inf)
    np.maximum.at(heights, tuple((squares - low).T), points[:, 2])
    heights = grey_closing(heights, 2)  # cells of a side that no point fell into
    behind, before = (
        heights[tuple((np.floor((points[:, :2] + step * normals[:, :2]) / cell).astype(int) - low).T)]
        for step in (-_STEP * cell, _STEP * cell)
    )
    level = (np.abs(normals[:, 2]) < 0.5) & (behind != before)
    inwards = np.where(level, behind < before, normals[:, 2] < 0)
    return np.where(inwards[:, None], -normals, normals)


def _patches(points: Array, normals: Array, cell: float) -> Index:
    """Return a number for each point (N,): of a small patch of one side (Papon et al. 2013, without their octree)."""
    from scipy.spatial import cKDTree

    from dexgrasp_env.perception.kernels import farthest_points

    rows = np.concatenate(
        [points, 0.012 * normals], axis=1
    )  # m apart that normals count as which are 1 apart
    middles = rows[farthest_points(np.ascontiguousarray(points), max(1, len(points) // 10), 0)]
    for _ in range(3):
        which = cKDTree(middles).query(rows)[1]
        middles = means_of(which, rows)
    _, which = np.unique(which, return_inverse=True)
    return which


def _seams(
    points: Array, normals: Array, patches: Index, plane: Plane, cell: float
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return pairs of patches (S, 2) that lie close, the sum of what parts them, and over how many pairs of points."""
    from scipy.spatial import cKDTree

    pairs = cKDTree(points).query_pairs(_LINK * cell, output_type="ndarray")
    x, y, z = (points[pairs[:, 0]] - points[pairs[:, 1]]).T
    near = pairs[x * x + y * y + z * z <= (1.47 * cell) ** 2]
    dense, up = np.bincount(near.ravel(), minlength=len(points)), plane.heights(points)
    pairs = pairs[patches[pairs[:, 0]] != patches[pairs[:, 1]]]
    a, b = pairs.T
    way = unit(points[a] - points[b])
    crease = np.minimum(dot(normals[a], way), -dot(normals[b], way))
    parts = (  # by logistic regression
        -3.4 * crease
        - 2.8 * dot(normals[a], normals[b])
        - 18.0 * np.minimum(0.5 * (up[a] + up[b]), 0.1)  # m above the table; more tells nothing
        - 0.38 * np.minimum(dense[a], dense[b])
        + 2.36
    )
    low, high = np.sort(patches[pairs], axis=1).T
    seams, which = np.unique(low * len(points) + high, return_inverse=True)
    both = np.stack(np.divmod(seams, len(points)), axis=1)
    return both, np.bincount(which, parts, len(seams)), np.bincount(which, minlength=len(seams))


def _join(
    sizes: Index, points: Array, patches: Index, pairs: NDArray[Any], parts: Array, links: NDArray[Any]
) -> tuple[Index, Mask]:
    """Join patches; return which thing each is of (K,), and whether thing k is doubtful (K,).

    Things that hang together by a few links that say little stay two: points that fly in a gap are such a bridge. The
    sides of a sheet, which is seen from both, hang together by no more.

    Args:
        sizes: (K,) points of each patch; those of things when it returns.
        points: (N, 3) m, thinned.
        patches: (N,) of each of these.
        pairs, parts, links: of the seams, as `_seams` returns them.
    """
    seams: list[dict[int, tuple[float, int]]] = [{} for _ in sizes]
    for (i, j), part, link in zip(pairs.tolist(), parts.tolist(), links.tolist(), strict=True):
        seams[i][j] = seams[j][i] = part, link
    heap = [
        (part / link, i, j, link) for i, own in enumerate(seams) for j, (part, link) in own.items() if i < j
    ]
    heapq.heapify(heap)
    things, weakest = np.arange(len(sizes)), np.full(len(sizes), -np.inf)
    cells = np.bincount(patches)

    def bridge(mean: float, i: int, j: int, link: int) -> bool:
        """Return true for a seam of stray points alone; the sides of a sheet are joined by few, too."""
        few = min(cells[i], cells[j])
        if mean < -2.0 or few < LEAST_POINTS or link > 0.1 * few:
            return False
        return not any(_is_sheet(points[things[patches] == k]) for k in (i, j))

    while heap and heap[0][0] < 0.0:
        mean, i, j, link = heapq.heappop(heap)
        has_grown = seams[i].get(j, (0.0, 0))[1] != link  # one of them, since
        if has_grown or bridge(mean, i, j, link):
            continue
        weakest[i] = max(weakest[i], weakest[j], mean if min(sizes[i], sizes[j]) >= LEAST_POINTS else -np.inf)
        sizes[i] += sizes[j]
        cells[i] += cells[j]
        things[things == j] = i
        for k, (part, link) in seams[j].items():
            del seams[k][j]
            if k != i:
                old = seams[i].get(k, (0.0, 0))
                seams[i][k] = seams[k][i] = new = part + old[0], link + old[1]
                heapq.heappush(heap, (new[0] / new[1], i, k, new[1]))
        seams[j] = {}
    doubt = 0.5  # that a seam is off what parts and what joins, within which it is doubtful
    doubtful = weakest > -doubt
    for i, own in enumerate(seams):
        doubtful[i] |= any(
            part < doubt * link and sizes[j] >= LEAST_POINTS for j, (part, link) in own.items()
        )
    return things, doubtful


def _with_crumbs(points: Array, labels: Index) -> Index:
    """Return labels (M,) in which what is no object by itself is of what it is near."""
    from scipy.spatial import cKDTree

    _, labels, counts = np.unique(labels, return_inverse=True, return_counts=True)
    sides = np.array([longest_side(points[labels == k]) for k in range(len(counts))])
    large = ((counts >= LEAST_POINTS) & (sides >= LEAST_EXTENT))[labels]
    if not large.any():
        return labels
    if not large.all():
        crumbs = np.flatnonzero(~large)
        distance, nearest = cKDTree(points[large]).query(points[crumbs], distance_upper_bound=0.015)  # m
        near = np.isfinite(distance)
        labels[crumbs[near]] = labels[large][nearest[near]]
    return _with_shared(points, labels)


def _with_shared(points: Array, labels: Index) -> Index:
    """Return labels (M,) in which things whose hulls share space are one: the inside of a cup is seen apart from it."""
    counts = np.bincount(labels)
    small = [k for k in np.argsort(-counts, kind="stable") if counts[k] >= 10]
    small = [k for k in small if longest_side(points[labels == k]) <= 0.15]
    hulls = {k: corners_and_volume(points[labels == k]) for k in small if len(small) > 1}
    for j, other in enumerate(small):
        for k in small[:j]:
            (mine, volume), (its, least) = hulls[k], hulls[other]
            if (mine.max(0) < its.min(0)).any() or (its.max(0) < mine.min(0)).any():
                continue
            both = corners_and_volume(np.concatenate([mine, its]))
            if volume + least - both[1] > 0.25 * min(volume, least):
                labels[labels == other], hulls[k] = k, both
                break
    return labels


def _with_walls(labels: Index, cloud: Cloud, link: float) -> Index:
    """Return labels (M,) in which upright sheets that stand in one row, longer than an object, are one thing."""
    if longest_side(cloud.points) <= MOST_EXTENT:
        return labels
    rows = linked(cloud.points, link)
    for row in range(rows.max() + 1):
        own = np.unique(labels[rows == row])
        if longest_side(cloud.points[rows == row]) <= MOST_EXTENT or len(own) < 2:
            continue
        sheets = [k for k in own if _is_sheet(cloud.points[labels == k])]
        labels[np.isin(labels, sheets)] = sheets[0] if sheets else 0
    return labels


def _is_sheet(points: Array) -> bool:
    """Return true for points (N, 3) in an upright sheet."""
    if len(points) < LEAST_POINTS or longest_side(points) < 0.05:
        return False
    across = np.linalg.svd(points - points.mean(0), full_matrices=False)[2][2]
    low, high = np.quantile(points @ across, (0.02, 0.98))
    return bool(high - low < 0.015 and abs(across[2]) < 0.5)  # m thick; of its normal that is up
