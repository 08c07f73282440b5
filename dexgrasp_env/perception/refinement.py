"""Refinement of a recorded cloud's instances: what is not known to be two is joined, and doubt is said."""

import numpy as np

from dexgrasp_env.arrays import Array, Index, Mask
from dexgrasp_env.perception.cloud import Cloud, thinned
from dexgrasp_env.perception.hulls import (
    THIN,
    deep_share,
    longest_side,
    low_and_high,
    volume_of,
)
from dexgrasp_env.perception.instances import (
    LEAST_EXTENT,
    LEAST_POINTS,
    MAY_BE_TWO,
    Instances,
    is_graspable,
    objects_in,
    segment_instances,
)
from dexgrasp_env.perception.neighbourhoods import gaps_between, spacing
from dexgrasp_env.perception.plane import Plane
from dexgrasp_env.perception.splinters import in_the_air, with_rims, with_splinters
from dexgrasp_env.perception.standing import (
    HIGH,
    are_two,
    has_foot,
    has_handle,
    in_order,
    is_carried,
    is_odd,
    may_be_two,
)
from dexgrasp_env.perception.viewpoint import View, find_viewpoint, hidden_in_part

# Figures of this file were set on scenes of the catalogue by `scripts/clouds.py parted`, other seeds than published.
TOP_ONLY = "was seen from above alone: its walls are taken to go straight down"
HIDDEN = "is hidden in part by another"
TOUCHES = "touches the next, or is one with it"


def refine_instances(cloud: Cloud, everything: Cloud, plane: Plane, *, pointed: bool = True) -> Instances:
    """Tell the things in what stands on a table apart; join what is not known to be two, and say what is doubtful.

    Args:
        cloud: what stands on the table, z = 0.
        everything: the same with the table.
        plane: the table.
        pointed: one of them is pointed at; otherwise a small part that touches a larger thing is of it, in doubt.
    """
    points, seen = cloud.points, everything.points
    labels = with_splinters(points, with_rims(points, segment_instances(cloud, plane).labels), seen)
    _, labels = np.unique(labels, return_inverse=True)
    for k in objects_in(points, labels):
        if is_odd(points[labels == k]):
            labels = _by_level(points, labels, labels == k)
    joined, several = set[int](), len(objects_in(points, labels)) > 1
    view = _view_of(cloud, everything) if several else None
    if several and not pointed:
        labels, joined = _with_parts(points, labels, seen, view)
    things = {k: points[labels == k] for k in objects_in(points, labels)}
    marked = np.where(np.isin(labels, list(things)), labels, -1)
    hidden = set[int]() if view is None else hidden_in_part(view, points, marked)
    doubts = [""] * (labels.max(initial=-1) + 1)
    for k, own in things.items():
        low, high = low_and_high(own)[0], own[:, 2].max()
        said = {
            MAY_BE_TWO: k in joined or may_be_two(own),
            TOUCHES: any(_touch(own, other) for j, other in things.items() if j != k),
            HIDDEN: k in hidden,
            TOP_ONLY: low > max(HIGH, 0.5 * high),  # half of its sides was not seen
        }
        doubts[k] = "; ".join(words for words, true in said.items() if true)
    return Instances(labels, tuple(doubts))


def _view_of(cloud: Cloud, everything: Cloud) -> View | None:
    """Return the view of the only camera; None where there are several, or nothing tells where it was."""
    if not np.ptp(everything.views, axis=0).any():
        eye = find_viewpoint(cloud.points, everything.points[np.abs(everything.points[:, 2]) < HIGH])
    else:
        eye = None if np.ptp(everything.camera) else everything.eye()
    return None if eye is None else View.of(everything.points, cloud.points, eye)


def _by_level(points: Array, labels: Index, mine: Mask) -> Index:
    """Return labels (N,) in which what stands on a level top of a thing is another."""
    level = 0.004  # m, height of a level
    heights = points[:, 2]
    counts = np.bincount(np.floor(heights[mine] / level).astype(int))
    best, least = labels, 0.05  # share of either part that may be deep
    for step in np.flatnonzero(counts > 2.5 * counts.mean()):  # a top fills its level
        upper = mine & (heights > (step + 2.5) * level)
        lower = mine & ~upper
        if min(upper.sum(), lower.sum()) < LEAST_POINTS or np.ptp(heights[upper]) < LEAST_EXTENT:
            continue
        deep = max(deep_share(points[upper]), deep_share(points[lower]))
        if deep < least and has_foot(points[upper], points[lower]):
            best, least = np.where(upper, labels.max() + 1, labels), deep
    return best


def _with_parts(points: Array, labels: Index, everything: Array, view: View | None) -> tuple[Index, set[int]]:
    """Return labels (N,) in which what may be a part of what it touches is of it, and the things that may be two.

    What touches nothing may be a part of what is near.
    """
    joined = set[int]()
    for k in reversed(objects_in(points, labels)):
        one = points[labels == k]
        others = {j: points[labels == j] for j in objects_in(points, labels) if j != k}
        others = {j: two for j, two in others.items() if is_graspable(np.concatenate([one, two]))}
        near = [j for j, two in others.items() if _is_near(one, two)]
        for j in near or sorted(others, key=lambda j: gaps_between(one, others[j]).min()):
            two = others[j]
            if near:
                apart = are_two(one, two, everything)
                is_one, doubtful = not apart or _is_part(one, two), apart and not _run_together(one, two)
            else:
                is_one, doubtful = _meet_unseen(one, two, everything, view)
            if is_one:
                joined = joined - {j, k} | ({j} if doubtful or {j, k} & joined else set())
                labels = np.where(labels == k, j, labels)
                break
    return labels, joined


def _meet_unseen(one: Array, two: Array, everything: Array, view: View | None) -> tuple[bool, bool]:
    """Return whether points (N, 3) m and others (M, 3) m may meet where nothing was seen, and whether that is doubtful.

    What hangs in the air over the other and would topple does, a rod with its end, what no ray passes between, and what
    is small and seen behind the other.
    """
    gap, (lower, upper, over) = gaps_between(one, two).min(), in_order(one, two)
    if over and in_the_air(upper, everything) and not is_carried(upper, lower):
        beside = gaps_between(one[:, :2], two[:, :2]).min() < 0.02  # m
        return beside, False
    if gap < 0.02 and not over and has_handle(one, two):  # m
        return True, True
    if gap > 0.037 or view is None:  # m
        return False, True
    few, many = sorted((one, two), key=volume_of)
    both, labels = np.concatenate([few, many]), np.repeat([0, 1], [len(few), len(many)])
    if not over and longest_side(both) < 0.26 and not view.separates(one, two):  # m
        return True, True
    return volume_of(few) < 0.1 * volume_of(many) and 0 in hidden_in_part(view, both, labels), True


def _is_part(one: Array, two: Array) -> bool:
    """Return true for points (N, 3) m that are small beside what they touch (M, 3) m, among it, or run on in it."""
    lower, upper, over = in_order(one, two)
    if over and is_carried(upper, lower):
        return False
    least, most, whole = (volume_of(some) for some in (one, two, np.concatenate([one, two])))
    if whole < 1.05 * most and longest_side(two) > 0.20:  # m: of a bin, which holds it
        return False
    shared = least + most - whole > 0.15 * min(least, most)
    return over or shared or least < 0.35 * most or _run_together(one, two)


def _run_together(one: Array, two: Array) -> bool:
    """Return true for points (N, 3) m beside others (M, 3) m that meet them in a band: what touches meets in a line."""
    few, many = sorted((points[thinned(points, THIN)] for points in (one, two)), key=len)
    near = 0.006  # m
    width = (gaps_between(few, many) < near).mean() * longest_side(few)  # m, of a band as long as the thing
    upper_over_lower = in_order(one, two)[2]  # what is low and stands on another meets it in a band as well
    return bool(width > 2.0 * near and not upper_over_lower)


def _touch(one: Array, other: Array) -> bool:
    """Return true for points (N, 3) m and (M, 3) that lie against each other."""
    one, other = (points[thinned(points, THIN)] for points in (one, other))
    near = gaps_between(other, one) < max(0.005, 1.5 * spacing(one))  # m
    return bool(near.sum() >= min(12, 0.2 * len(one), 0.2 * len(other)))


def _is_near(one: Array, two: Array) -> bool:
    """Return true for points (N, 3) m as near to others (M, 3) m as those of one thing lie."""
    return bool(gaps_between(one, two).min() <= max(0.006, 1.7 * spacing(two)))
