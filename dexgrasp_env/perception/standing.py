"""Evidence that what was seen as one is two things: cut in two it is explained, and either part may stand.

Much of what they are lies deep in the hull around both, unlike with one convex or hollow thing. What stands on another
has a foot wide enough there, under its middle; tops side by side differ in height. Heights are over the table.
"""

from typing import NamedTuple

import numpy as np

from dexgrasp_env.arrays import Array, Mask
from dexgrasp_env.perception.cloud import thinned
from dexgrasp_env.perception.hulls import (
    THIN,
    beyond,
    deep_share,
    hull_of,
    is_hollow,
    is_slim,
    longest_side,
    low_and_high,
    volume_of,
)
from dexgrasp_env.perception.neighbourhoods import gaps_between
from dexgrasp_env.perception.splinters import in_the_air

HIGH = 0.02
"""m over the table from which on a part does not reach it."""
_FOOT = 0.012  # m, height of what carries a thing, or of its foot


class Cut(NamedTuple):
    """A plane that parts a thing into two where their hulls hold least.

    Attributes:
        across: (3,) its normal.
        place: m along that.
    """

    across: Array
    place: float

    @classmethod
    def of(cls, points: Array, ways: Array) -> "Cut":
        """Return the best cut of points (N, 3) m across one of the ways (K, 3)."""
        spans = ((way, points @ way) for way in ways)
        cuts = (cls(way, at) for way, on in spans for at in np.linspace(on.min(), on.max(), 14)[1:-1])
        return min(cuts, key=lambda cut: cut.volume(points))

    def parts(self, points: Array) -> tuple[Array, Array]:
        """Return the points (N, 3) m before it, and those behind it."""
        behind = points @ self.across >= self.place
        return points[~behind], points[behind]

    def volume(self, points: Array) -> float:
        """Return the volume, m3, of the hulls of both parts of points (N, 3) m."""
        return sum(map(volume_of, self.parts(points)))

    def is_topped(self, points: Array) -> bool:
        """Return true where the top of points (N, 3) m runs on across an upright cut: of two things it differs."""
        off = points @ self.across - self.place
        beside = (points[(np.abs(off) < 0.025) & side] for side in (off < 0.0, off >= 0.0))  # m
        tops = [low_and_high(part)[1] for part in beside if len(part)]
        return bool(tops and np.ptp(tops) < min(0.003, 0.2 * points[:, 2].max()))


def is_odd(points: Array, share: float = 0.07) -> bool:
    """Return true for points (N, 3) m of which more than a share lie deep in their hull, though it is not hollow."""
    return deep_share(points) > share and not is_hollow(points)


def may_be_two(points: Array) -> bool:
    """Return true for points (N, 3) m that two things would explain, longer than one by itself most often is.

    A thing with a neck is one, or with a rod, and of two parts side by side a top that runs on makes one.
    """
    if longest_side(points) < 0.11 or not is_odd(points, 0.025):  # m
        return False
    few, angles = points[thinned(points, 0.006)], np.arange(12) * np.pi / 12.0
    level = Cut.of(few, np.array([[0.0, 0.0, 1.0]]))
    upright = Cut.of(few, np.stack([np.cos(angles), np.sin(angles), np.zeros(12)], axis=1))
    (low, high), (one, other) = level.parts(points), upright.parts(points)
    if has_handle(one, other) or not is_carried(high, low):
        return False
    whole = upright.is_topped(points) and not any(is_odd(part, 0.03) for part in (one, other))
    return not whole or level.volume(few) < 0.7 * volume_of(few)


def are_two(one: Array, other: Array, everything: Array) -> bool:
    """Return true for points (N, 3) m and (M, 3) that may be by themselves, among all that was seen (L, 3) m.

    One is no handle of the other, and stands on it or on the table, unless what is under it is hidden.
    """
    if has_handle(one, other):
        return False
    lower, upper, over = in_order(one, other)
    return has_foot(upper, lower) if over else not in_the_air(upper, everything)


def in_order(one: Array, other: Array) -> tuple[Array, Array, bool]:
    """Return the lower and the upper of points (N, 3) m and (M, 3) m, and true where that begins above most of it."""
    lower, upper = sorted((one, other), key=lambda part: low_and_high(part)[0])
    return lower, upper, low_and_high(upper)[0] > 0.8 * low_and_high(lower)[1]


def has_handle(one: Array, other: Array) -> bool:
    """Return true where points (N, 3) m or others (M, 3) m are of a rod of which an end is nearest to the rest."""
    for rod, rest in ((one, other), (other, one)):
        flat = rod - rod.mean(0)
        along = flat @ np.linalg.eigh(flat.T @ flat)[1][:, ::-1]
        low, high = np.quantile(along, (0.03, 0.97), axis=0)
        length, width, _ = high - low
        if width <= min(0.035, length / 2.5):  # m
            gaps = gaps_between(rod, rest)
            meets = along[gaps < gaps.min() + 0.005, 0] - 0.5 * (low + high)[0]
            if np.abs(meets).mean() > 0.3 * length:
                return True
    return False


def has_foot(upper: Array, lower: Array) -> bool:
    """Return true for points (N, 3) m wide enough to stand on a lower thing (M, 3) m that has no neck there."""
    low, least = low_and_high(upper)[0], 0.03  # m, of what carries things
    foot = upper[upper[:, 2] < low + _FOOT]
    neck = lower[np.abs(lower[:, 2] - min(low, low_and_high(lower)[1])) < _FOOT]
    return not is_slim(upper) and all(
        np.ptp(some[:, :2], axis=0).max() > least for some in (foot, neck) if len(some)
    )


def is_carried(upper: Array, lower: Array) -> bool:
    """Return true for points (N, 3) m that may stand on a lower thing (M, 3) m: their middle is over it, about."""
    return has_foot(upper, lower) and overhang(upper, lower) <= 0.03  # m


def overhang(upper: Array, lower: Array) -> float:
    """Return how far, m, the middle of points (N, 3) m is beyond the outline of others (M, 3), below 0 over them."""
    outline = hull_of(lower[:, :2])
    return np.inf if outline is None else float(beyond(outline, upper[:, :2].mean(0)[None])[0])


def foot_of(points: Array, mine: Mask) -> float:
    """Return the height, m, of what carries a thing (N,) among points (N, 3) m; 0 for the table."""
    low = low_and_high(points[mine])[0]
    under = ~mine & (np.abs(points[:, 2] - low) < _FOOT)
    if low < HIGH or not under.any() or (outline := hull_of(points[mine, :2])) is None:
        return 0.0
    under[under] = beyond(outline, points[under, :2]) < 0.0
    return float(min(np.median(points[under, 2]), low)) if under.sum() >= 5 else 0.0


def without_skirt(points: Array) -> Mask:
    """Return which of a thing's points (N, 3) m are not the table's, which bends up at the foot of things."""
    low = points[:, 2] < 0.010  # m that the table bends up; where it is more of the thing, it is its own
    outline = hull_of(points[~low, :2])
    if outline is None or not 0.0 < low.mean() < 0.15:
        return np.ones(len(points), bool)
    low[low] = beyond(outline, points[low, :2]) > THIN
    return ~low
