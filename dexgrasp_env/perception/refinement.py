"""Refinement of a recorded cloud's instances: what is not known to be two is joined, and doubt is said.

Holes, flying points and hidden sides tear a thing: its splinters lie along it, and what is hollow is seen as an outer
and an inner side that meet in a rim.
"""

from itertools import combinations
from typing import Any

import numpy as np

from dexgrasp_env.arrays import Array, Index, Mask
from dexgrasp_env.perception.cloud import Cloud, thinned
from dexgrasp_env.perception.instances import (
    LEAST_EXTENT,
    LEAST_POINTS,
    MAY_BE_TWO,
    MOST_EXTENT,
    Instances,
    corners_and_volume,
    hull_of,
    longest_side,
    objects_in,
    segment_instances,
)
from dexgrasp_env.perception.levels import cells_at
from dexgrasp_env.perception.plane import Plane
from dexgrasp_env.perception.viewpoint import find_viewpoint, hidden_in_part

# Figures of this file were set on scenes of the catalogue by `scripts/clouds.py parted`, other seeds than published.
_CELL = 0.004  # m, to which points are thinned
_TOUCH = 0.004  # m between points of one thing
_HIGH = 0.02  # m over the table of what hangs, or was seen from above alone
_LOW = 0.02  # quantile of a thing's lowest, and highest, points
TOP_ONLY = "was seen from above alone: its walls are taken to go straight down"
HIDDEN = "is hidden in part by another"
TOUCHES = "touches the next, or is one with it"


def refine_instances(cloud: Cloud, everything: Cloud, plane: Plane, *, pointed: bool = True) -> Instances:
    """Tell the things in what stands on a table apart; join what is not known to be two, and say what is doubtful.

    Args:
        cloud: what stands on the table.
        everything: the same with the table.
        plane: the table.
        pointed: one of them is pointed at; otherwise a small part that touches a larger thing is of it, in doubt.
    """
    found, heights = segment_instances(cloud, plane), plane.heights(cloud.points)
    labels = _with_splinters(
        cloud.points, _with_rims(cloud.points, found.labels, heights), heights, everything.points
    )
    _, labels = np.unique(labels, return_inverse=True)
    whole, deep = labels, _deep_shares(cloud.points, labels)
    odd = {k: may_be_two(deep[k], cloud.points[labels == k], heights[labels == k]) for k in deep}
    for k in filter(odd.get, odd):
        labels = _by_level(cloud.points, labels, labels == k, heights)
    hung, joined = set[int](), set[int]()
    if not pointed:
        labels, hung = _with_hanging(cloud.points, labels, everything.points)
        labels, joined = _with_parts(cloud.points, labels, heights, everything.points)
    if labels is not whole:
        deep = _deep_shares(cloud.points, labels)
    things = {k: (cloud.points[labels == k], heights[labels == k]) for k in deep}
    marked = np.where(np.isin(labels, list(deep)), labels, -1)
    hidden = _occluded(cloud, everything, plane, marked) if len(things) > 1 else set()
    doubts = [""] * (labels.max(initial=-1) + 1)
    for k, (points, high) in things.items():
        others = [other for j, (other, _) in things.items() if j != k]
        said = {
            MAY_BE_TWO: k in hung
            or ((k in joined or may_be_two(deep[k], points, high, 0.03)) and not _is_sure(points, high)),
            TOUCHES: any(_touch(points, other) for other in others),
            HIDDEN: k in hidden,
            # Half of its sides was not seen.
            TOP_ONLY: np.quantile(high, _LOW) > max(_HIGH, 0.5 * high.max()),
        }
        doubts[k] = "; ".join(words for words, true in said.items() if true)
    return Instances(labels, tuple(doubts))


def _occluded(cloud: Cloud, everything: Cloud, plane: Plane, labels: Index) -> set[int]:
    """Return the things that others hide in part from the only camera; none where there are several."""
    over = plane.heights(everything.points)
    upright, raised = (np.c_[c.points[:, :2], plane.heights(c.points)] for c in (everything, cloud))
    if not np.ptp(everything.views, axis=0).any():
        eye = find_viewpoint(raised, upright[np.abs(over) < _HIGH])
    else:
        eye = None if np.ptp(everything.camera) else everything.eye()
    if eye is None:
        return set()
    of = np.full(max(everything.pixel.max(), cloud.pixel.max()) + 1, -1)
    of[cloud.pixel] = labels
    return hidden_in_part(upright, of[everything.pixel], eye)


def foot_of(points: Array, mine: Mask, heights: Array) -> float:
    """Return the height, m over the table, of what carries a thing (N,) among points (N, 3) m; 0 for the table."""
    low, outline = float(np.quantile(heights[mine], _LOW)), hull_of(points[mine, :2])
    under = ~mine & (np.abs(heights - low) < 0.012)  # m within which what carries it ends
    if low < _HIGH or outline is None or not under.any():
        return 0.0
    under[under] = _beyond(outline, points[under, :2]) < 0.0
    return float(min(np.median(heights[under]), low)) if under.sum() >= 5 else 0.0


def without_skirt(points: Array, heights: Array) -> Mask:
    """Return which of a thing's points (N, 3) m are not the table's, which bends up at the foot of things."""
    low = heights < 0.010  # m that the table bends up; where it is more of the thing, it is its own
    outline = hull_of(points[~low, :2])
    if outline is None or not 0.0 < low.mean() < 0.15:
        return np.ones(len(points), bool)
    low[low] = _beyond(outline, points[low, :2]) > _TOUCH
    return ~low


def _beyond(hull: Any, points: Array) -> Array:
    """Return how far points (N, n) lie outside a hull (N,), below 0 inside."""
    return np.asarray((points @ hull.equations[:, :-1].T + hull.equations[:, -1]).max(1))


def _touch(one: Array, other: Array) -> bool:
    """Return true for points (N, 3) m and (M, 3) that lie against each other."""
    from scipy.spatial import cKDTree

    one, other = (points[thinned(points, _CELL)] for points in (one, other))
    tree = cKDTree(one)
    near = np.isfinite(tree.query(other, distance_upper_bound=max(0.005, 1.5 * _spacing(tree)))[0])  # m
    return bool(near.sum() >= min(12, 0.2 * len(one), 0.2 * len(other)))


def _spacing(tree: Any) -> float:
    """Return the median distance, m, of a point of a k-d tree from the next one."""
    return float(np.median(tree.query(tree.data, k=[2])[0]))


def _deep_shares(points: Array, labels: Index) -> dict[int, float]:
    """Return the share of its points that lie deep of each object among points (N, 3) m, the largest object first."""
    return {k: deep_share(points[labels == k]) for k in objects_in(points, labels)}


def deep_share(points: Array) -> float:
    """Return the share of points (N, 3) m that lie deep, 1 cm, inside their convex hull."""
    points = points[thinned(points, _CELL)]
    hull = hull_of(points)
    return 0.0 if hull is None else float((_beyond(hull, points) < -0.010).mean())


def may_be_two(share: float, points: Array, heights: Array, most: float = 0.07) -> bool:
    """Return true for points (N, 3) m, as high over the table, of a shape that is neither convex nor hollow.

    A share of more than `most` of them lies deep inside the hull: of convex things alone none does.
    """
    return share > most and not is_hollow(points, heights)


def _by_level(points: Array, labels: Index, mine: Mask, heights: Array) -> Index:
    """Return labels (N,) in which what stands on a level top of a thing is another."""
    level = 0.004  # m, height of a level
    steps = np.floor(heights[mine] / level).astype(int)
    counts = np.bincount(steps)
    best, least = labels, 0.05  # share of either part that may be deep
    for step in np.flatnonzero(counts > 2.5 * counts.mean()):  # a top fills its level
        upper = mine & (heights > (step + 2.5) * level)
        lower = mine & ~upper
        if min(upper.sum(), lower.sum()) < LEAST_POINTS or np.ptp(heights[upper]) < LEAST_EXTENT:
            continue
        deep = max(deep_share(points[upper]), deep_share(points[lower]))
        if (
            deep < least and longest_side(points[upper]) > 0.035 and not _is_slim(points[upper])
        ):  # m: of no knob
            best, least = np.where(upper, labels.max() + 1, labels), deep
    return best


def _with_rims(points: Array, labels: Index, heights: Array) -> Index:
    """Return labels (N,) in which the outer and the inner side of a hollow thing are one."""
    joined = True
    while joined:
        joined = False
        counts = np.bincount(labels)
        numbers = [k for k in np.argsort(-counts) if counts[k] >= LEAST_POINTS]
        for i, j in combinations(numbers, 2):
            both = (labels == i) | (labels == j)
            if longest_side(points[both]) < 0.26 and is_hollow(points[both], heights[both]):
                labels = np.where(labels == j, i, labels)
                joined = True
                break
    return labels


def is_hollow(points: Array, heights: Array) -> bool:
    """Return true for points (N, 3) m, as high over the table, that end in a rim around what is lower."""
    from scipy.spatial import cKDTree

    top = np.quantile(heights, 1.0 - _LOW)
    rim = points[heights > top - max(0.012, 0.15 * top), :2]
    rim = rim[thinned(rim, _CELL)]
    around, whole, width = hull_of(rim), hull_of(points[:, :2]), np.ptp(rim, axis=0).min()
    if around is None or width < 0.04 or around.volume < 0.6 * whole.volume:
        return False
    wall = max(0.012, 0.12 * width)  # m from its outline within which a rim lies
    on_it = _beyond(around, rim) > -wall
    corners = rim[around.vertices]
    sides = np.roll(corners, -1, axis=0) - corners
    places = np.linspace(0.0, 1.0, 16)  # of each side
    outline = (corners + places[:, None, None] * sides).reshape(-1, 2)
    length = np.tile(np.linalg.norm(sides, axis=1), len(places))
    seen = cKDTree(rim[on_it]).query(outline)[0] < wall
    return bool(on_it.mean() > 0.85 and length[seen].sum() > 0.65 * length.sum())


def _with_splinters(points: Array, labels: Index, heights: Array, everything: Array) -> Index:
    """Return labels (N,) in which what is no thing by itself is of a larger one.

    Such are small things along it, things in the air beside it, and the inner side of its walls.
    """
    from scipy.spatial import cKDTree

    for k in np.argsort(np.bincount(labels)):
        mine = labels == k
        if not mine.any():
            continue
        if (whole := _lined(points, labels, mine, heights)) is not None:
            labels[mine] = whole
            continue
        larger = np.bincount(labels)[labels] > mine.sum() / 0.3  # of its points
        if not larger.any():
            continue
        distance, nearest = cKDTree(points[larger]).query(points[mine])
        along = np.quantile(distance, 0.1) < _TOUCH and (distance < 0.010).mean() > 0.5
        size, far = longest_side(points[mine]), distance.min()
        hangs = heights[mine].min() > _HIGH and (
            (size < 0.10 and far < 0.025)
            or (size < 0.04 and far < 0.05)
            or (far < 0.05 and _hangs(points[mine], everything))
        )
        if along or hangs:
            labels[mine] = np.bincount(labels[larger][nearest]).argmax()
    return labels


def _hangs(points: Array, everything: Array) -> bool:
    """Return true for points (N, 3) m below which others (M, 3) m are seen: what stands hides what is under it."""
    low, side = points[:, 2].min(), 2.0 * _CELL
    below = everything[everything[:, 2] < low - 0.010]
    own, others = (np.unique(cells_at(some, side) @ [1, 1 << 20]) for some in (points, below))
    return bool(low > _HIGH and np.isin(own, others).mean() > 0.3)


def _lined(points: Array, labels: Index, mine: Mask, heights: Array) -> int | None:
    """Return the larger thing whose walls a thing (N,) lines on the inside, None where there is none."""
    counts = np.bincount(labels)
    for k in np.argsort(-counts):
        if counts[k] <= mine.sum():
            return None
        other = labels == k
        feet = points[other] - heights[other, None] * [0.0, 0.0, 1.0]
        hulls = (hull_of(points[other]), hull_of(np.concatenate([points[other], feet])))
        if any(hull is not None and _lies_in_walls(hull, points[mine]) for hull in hulls):
            return int(k)
    return None


def _lies_in_walls(hull: Any, points: Array) -> bool:
    """Return true for points (N, 3) m in a hull of which most lie just behind its sides or its bottom."""
    sides = hull.equations[hull.equations[:, 2] < 0.5]
    behind = (points @ sides[:, :-1].T + sides[:, -1]).max(1)
    return bool((_beyond(hull, points) < 0.003).mean() > 0.9 and (behind > -0.010).mean() > 0.8)


def _with_parts(points: Array, labels: Index, heights: Array, everything: Array) -> tuple[Index, set[int]]:
    """Return labels (N,) in which what may be a part of what it touches is of it, and the things that may be two.

    A part is small beside the other, in the air, or shares space with it, and does not stand on it.
    """
    joined = set[int]()
    for k in reversed(objects_in(points, labels)):
        for j in (j for j in objects_in(points, labels) if j != k):
            one, two = points[labels == k], points[labels == j]
            both = np.concatenate([one, two])
            if longest_side(both) > MOST_EXTENT or not _is_near(one, two):
                continue
            upper, lower = (k, j) if one[:, 2].min() > two[:, 2].min() else (j, k)
            stands = foot_of(points, labels == upper, heights) > 0.0
            held = stands and _can_stand(points[labels == upper], points[labels == lower])
            if held:
                continue
            least, most, whole = (corners_and_volume(some)[1] for some in (one, two, both))
            shared = least + most - whole > 0.15 * min(least, most)
            if whole < 1.05 * most and longest_side(two) > 0.20:  # m: of a bin, which holds it
                continue
            hangs = any(_hangs(some, everything) for some in (one, two))
            if stands or shared or hangs or least < 0.35 * most:
                labels, joined = np.where(labels == k, j, labels), joined - {k} | {j}
                break
    return labels, joined


def _with_hanging(points: Array, labels: Index, everything: Array) -> tuple[Index, set[int]]:
    """Return labels (N,) in which what hangs in the air is of the nearest thing, and the things that may be two.

    What may stand on that, its middle being over it, is another: where it touches may be hidden.
    """
    from scipy.spatial import cKDTree

    joined = set[int]()
    for k in reversed(objects_in(points, labels)):
        one = points[labels == k]
        if not _hangs(one, everything):
            continue
        gaps = dict[int, float]()
        for j in (j for j in objects_in(points, labels) if j != k):
            two = points[labels == j]
            beside = cKDTree(two[:, :2]).query(one[:, :2])[0].min() < 0.02  # m
            over = one[:, 2].min() > 0.8 * two[:, 2].max()  # what is beside may be hidden in its lower part
            if beside and over and longest_side(np.concatenate([one, two])) <= MOST_EXTENT:
                gaps[j] = cKDTree(two).query(one)[0].min()
        if not gaps or any(_is_near(one, points[labels == j]) for j in gaps):
            continue
        j = min(gaps, key=gaps.__getitem__)
        outline = hull_of(points[labels == j, :2])
        if outline is not None and _beyond(outline, one[:, :2].mean(0)[None])[0] > 0.03:  # m
            labels, joined = np.where(labels == k, j, labels), joined - {k} | {j}
    return labels, joined


def _is_near(one: Array, two: Array) -> bool:
    """Return true for points (N, 3) m as near to others (M, 3) m as those of one thing lie."""
    from scipy.spatial import cKDTree

    tree = cKDTree(two)
    return bool(tree.query(one)[0].min() <= max(0.006, 1.7 * _spacing(tree)))


def _can_stand(points: Array, lower: Array) -> bool:
    """Return true for points (N, 3) m that may stand by themselves on a lower thing (M, 3) m.

    They are no slimmer than things stand, begin at its top, and have their middle over what touches it.
    """
    from scipy.spatial import cKDTree

    some = points[thinned(points, _CELL)]
    low = np.quantile(some[:, 2], _LOW)
    if _is_slim(some) or low < 0.8 * np.quantile(lower[:, 2], 1.0 - _LOW):
        return False
    foot = some[some[:, 2] < low + 0.012]
    held = hull_of(foot[cKDTree(lower).query(foot)[0] < 0.015, :2])
    return held is not None and bool(_beyond(held, some[:, :2].mean(0)[None])[0] < 0.010)


def _is_slim(points: Array) -> bool:
    """Return true for points (N, 3) m more than six times as high as wide, which do not stand by themselves."""
    flat = points[:, :2] - points[:, :2].mean(0)
    across = np.linalg.eigh(flat.T @ flat)[1][:, 0]
    return bool(np.ptp(points[:, 2]) > 6.0 * np.ptp(flat @ across))


def _is_sure(points: Array, heights: Array) -> bool:
    """Return true for points (N, 3) m, as high over the table, that are one thing, though neither convex nor hollow.

    They are cut in two where the hulls of both hold least. Things side by side differ in height there, where the top of
    one thing runs on; what is over a level cut may stand there, unless it is slim.
    """
    some = np.c_[points[:, :2], heights]
    few, angles = some[thinned(some, 0.006)], np.arange(12) * np.pi / 12.0
    beside = min((_cut(few, np.array([np.cos(a), np.sin(a), 0.0])) for a in angles), key=lambda cut: cut[0])
    over = _cut(few, np.array([0.0, 0.0, 1.0]))
    saved = [corners_and_volume(few)[1] - volume for volume, _, _ in (beside, over)]
    if saved[1] > 0.6 * saved[0]:
        return _is_slim(some[some[:, 2] >= over[1]])
    _, place, across = beside
    off, row = some @ across - place, np.floor(some @ np.cross([0.0, 0.0, 1.0], across) / 0.005).astype(int)
    near = np.abs(off) < 0.008  # m
    steps = [
        abs(np.quantile(heights[own & (off < 0.0)], 0.9) - np.quantile(heights[own & (off >= 0.0)], 0.9))
        for own in (near & (row == k) for k in np.unique(row[near]))
        if (off[own] < 0.0).any() and (off[own] >= 0.0).any()
    ]
    return bool(steps and np.median(steps) < min(0.0025, 0.2 * heights.max()))


def _cut(points: Array, across: Array) -> tuple[float, float, Array]:
    """Return the least volume, m3, of the hulls of two parts of points (N, 3) m, where the cut is, and its normal."""
    along = points @ across
    places = np.linspace(along.min(), along.max(), 14)[1:-1]
    volumes = [
        sum(corners_and_volume(part)[1] for part in (points[along < place], points[along >= place]))
        for place in places
    ]
    best = int(np.argmin(volumes))
    return volumes[best], float(places[best]), across
