"""Proposals of contacts: triples or pairs of a surface, the interface of learned sources, and one ranking of all by how
well they bear errors.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from dexgrasp.geometry.surface_samples import triangle_samples
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.thresholds import PRESSED
from dexgrasp.mechanics.closure import closure_sweep, opposed_pairs
from dexgrasp.mechanics.margin import margins, margins_to
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp_env.arrays import Array, Index, Mask
from dexgrasp_env.compiled import njit
from dexgrasp_env.robot.robot import Hand

LEAST_DISTANCE = 0.03
"""m between contacts: two fingertips are wider than this."""
LEAST_OPENING = 0.006
"""m that a fingertip backs off at least before it closes."""
LEAST_GAP = 0.01
"""m between two contacts that face each other."""
_ROUNDING = 1e-4  # m
_DENSE = 20  # times as many places beside a low object are tried as are asked for
_DENSER = 6  # times as many points are sampled where contacts are asked for in a part of the surface
_STEPS = 4  # of Newton's method, until a tip beside it touches
_LEVEL = 0.05  # least squared level part of a normal along which a tip is moved
_JUDGED = 30  # times as many feasible triples have their margin computed as are proposed
_ENOUGH = 0.7  # closure margin from where more is no merit
_ROUGH = 1e-3  # of the closure margins that are ranked by
_AT_ONCE = 48  # triples whose margins are computed together
_APART = 0.006  # m, mean distance of the fingertips of two triples that are not the same
_NO_CLOSURE, _NO_SURFACE = "no_closure_triple", "no_surface_above_table"
_NO_PLACE = "no_surface_as_requested"


@dataclass(frozen=True)
class Proposals:
    """K contact triples, or pairs for two fingers, best first; further fingers follow the first three.

    Attributes:
        contacts: (K, n, 3) m, world frame.
        normals: (K, n, 3) out of the object.
        assigned: whether the order is thumb, index, middle; otherwise any finger may take any contact.
        failure: why there are none.
        palms: (K, 4, 4) where the source would have the palm, world frame; None where it does not say.
    """

    contacts: Array
    normals: Array
    assigned: bool = False
    failure: str | None = None
    palms: Array | None = None

    @classmethod
    def none(cls, failure: str) -> "Proposals":
        """Return an empty set with its reason."""
        empty = np.zeros((0, 3, 3))
        return cls(empty, empty, failure=failure)


class ProposalSource(ABC):
    """A source of contact triples."""

    def check_hand(self, hand: Hand) -> None:  # noqa: B027  (most sources serve any hand)
        """Refuse a hand that the source cannot propose for.

        Raises:
            InputError: naming the hand that it is of.
        """

    @abstractmethod
    def propose(self, target: GraspTarget, settings: PlannerSettings, rng: Generator) -> Proposals:
        """Return proposals for an object, best first."""


class SurfaceProposals(ProposalSource):
    """All triples or pairs of sampled surface points, judged for force closure and ranked."""

    def propose(self, target: GraspTarget, settings: PlannerSettings, rng: Generator) -> Proposals:
        """Return up to `settings.triples` triples, varied as well as good."""
        points, normals = self.places(target, settings, rng)
        if len(points) < min(3, settings.fingers):
            return Proposals.none(_NO_PLACE if target.narrowed else _NO_SURFACE)
        triples = closing_sets(points, normals, settings)
        if not len(triples):
            return Proposals.none(_NO_CLOSURE)
        judged = _JUDGED * settings.triples
        if len(triples) > judged:
            triples = triples[rng.choice(len(triples), judged, replace=False)]
        contacts, at = points[triples], normals[triples]
        margin = margins(contacts, at, settings.friction, settings.model)
        if (closed := margin > 0.0).any():  # the sweep's pyramids reach beyond the cones
            triples, contacts, at, margin = triples[closed], contacts[closed], at[closed], margin[closed]
        chosen = best_shared(triples, robustness(contacts, at, margin, target), settings.triples)
        return Proposals(contacts[chosen], at[chosen])

    def places(self, target: GraspTarget, settings: PlannerSettings, rng: Generator) -> tuple[Array, Array]:
        """Return the contacts (N, 3) m and outward normals (N, 3) that triples are made of."""
        return graspable_points(target, settings, rng)


def closing_sets(points: Array, normals: Array, settings: PlannerSettings) -> NDArray[np.int32]:
    """Return all triples (M, 3) of contacts (N, 3) m that may close, or pairs (M, 2) for two fingers."""
    if settings.fingers == 2:
        return opposed_pairs(points, normals, settings.friction, LEAST_GAP, settings.widest)
    return closure_sweep(points, normals, settings.friction, LEAST_DISTANCE)


def graspable_points(target: GraspTarget, settings: PlannerSettings, rng: Generator) -> tuple[Array, Array]:
    """Sample points (N, 3) m and outward normals (N, 3) that a fingertip can reach above the table.

    Where neighbours leave a fingertip no room, there is none. On a low object hardly any point of an even sample can be
    reached: tips are placed beside it instead.

    The normal is the gradient of the distance at the centre of the touching fingertip: smooth over edges. Where another
    part is nearer to the fingertip than the point is, it cannot touch there.
    """
    if settings.is_low(target.top):
        return _points_beside(target, settings, rng)
    asked = target.narrowed
    count = settings.surface_points * (_DENSER if asked else 1)
    samples = triangle_samples(target.distance.triangles, count, rng)
    centres = samples.points + settings.tip_height * samples.normals
    above = samples.points[:, 2] > settings.table_clearance
    above &= centres[:, 2] > settings.tip_radius + settings.clearance
    centres = centres[above]
    distance, gradient = target.distance.distance_gradient(centres)
    contacts = centres - distance[:, None] * gradient
    touching = (distance > settings.tip_height - _ROUNDING) & fits(centres, gradient, target, settings)
    touching &= target.was_seen(contacts)
    if asked:
        touching = rng.permutation(np.flatnonzero(touching))[: settings.surface_points]
    return contacts[touching], gradient[touching]


def _points_beside(target: GraspTarget, settings: PlannerSettings, rng: Generator) -> tuple[Array, Array]:
    """Return contacts (N, 3) m of tips beside a low object, and normals (N, 3).

    Tips stand anywhere between the table and the object's top, as far off as they may be when they touch: they feel an
    edge below them least there. They are moved level until they touch. Where a normal points up by more than friction
    holds, a tip slides off.
    """
    corners, height = target.distance.triangles.reshape(-1, 3), settings.tip_radius + settings.distance[1]
    least = settings.tip_radius + settings.off_table(target.top)
    low, high = corners.min(0) - height, corners.max(0) + height
    low[2], high[2] = least, max(least, target.top)
    tips = rng.uniform(low, high, (_DENSE * settings.surface_points, 3))
    for _ in range(_STEPS):
        distance, normals = target.distance.distance_gradient(tips)
        level = normals[:, :2]
        away = (height - distance) / np.maximum((level * level).sum(1), _LEVEL)
        tips[:, :2] += away[:, None] * level
    distance, normals = target.distance.distance_gradient(tips)
    contacts = tips - distance[:, None] * normals
    usable = (np.abs(distance - height) < _ROUNDING) & (contacts[:, 2] > settings.lowest_contact(target.top))
    usable &= fits(tips, normals, target, settings) & target.was_seen(contacts)
    usable &= normals[:, 2] < np.sin(np.arctan(settings.friction))
    kept = np.flatnonzero(usable)[: settings.surface_points // 2]
    return contacts[kept], normals[kept]


def fits(centres: Array, normals: Array, target: GraspTarget, settings: PlannerSettings) -> Mask:
    """Return where the centre of a fingertip (N, 3) m may be (N,): it touches nothing that is not to be touched.

    Args:
        centres: where it touches the object.
        normals: (N, 3) out of the object, along which it backs off.
        target: the object, with what is barred of it, and its neighbours, clear of which it is open or closed.
        settings: for the tip.
    """
    out = settings.tip_radius + settings.distance[1] - settings.tip_height  # m, as far as it may be
    free: Mask = target.barred.query(centres + out * normals)[0] > settings.tip_radius - PRESSED
    if target.around is None:
        return free
    least = settings.tip_radius + settings.clearance
    for way in (centres, centres + LEAST_OPENING * normals):
        free &= target.around.distance(way) > least
    return free


def robustness(contacts: Array, normals: Array, margins: Array, target: GraspTarget) -> Array:
    """Return how well K triples bear errors (K,), in units of closure margin: their margin, less `contact_sensitivity`.

    Args:
        contacts: (K, N, 3) m.
        normals: (K, N, 3) out of the object.
        margins: (K,) of force closure.
        target: the object.
    """
    return np.minimum(margins, _ENOUGH) - contact_sensitivity(contacts, normals, target)


def contact_sensitivity(contacts: Array, normals: Array, target: GraspTarget) -> Array:
    """Return what K grasps (K, N, 3) risk, in units of closure margin, if the surface is not quite where it was seen.

    Gravity turns contacts far from the centre of mass. A contact off the object's middle height, or whose normal points
    up, squeezes the object out of the hand if the true surface curves away.
    """
    size = np.linalg.norm(np.ptp(target.distance.triangles, axis=(0, 1)))
    offset = np.linalg.norm(contacts.mean(1) - target.centre, axis=1) / size
    uneven = np.abs(contacts[..., 2] - target.centre[2]).max(1) / target.top
    return offset + uneven + np.maximum(normals[..., 2], 0.0).max(1)


def most_robust(contacts: Array, normals: Array, target: GraspTarget, settings: PlannerSettings) -> Index:
    """Return the `settings.triples` most robust of triples in closure, best first.

    Those nearly the same as a better one are left out. Margins, the dear part, are at most `_ROUGH` too low. They are
    computed best first by what robustness could be at most, and not for triples that cannot be among the best any more.
    """
    risk = contact_sensitivity(contacts, normals, target)
    order = np.argsort(risk, kind="stable")
    score = np.full(len(order), -np.inf)
    for first in range(0, len(order), _AT_ONCE):
        some = order[first : first + _AT_ONCE]
        known = margins_to(contacts[some], normals[some], settings.friction, settings.proposed, _ROUGH, 0.0)
        margin = known - _ROUGH
        score[some] = np.where(margin > 0.0, np.minimum(margin, _ENOUGH) - risk[some], -np.inf)
        best = np.argsort(-score, kind="stable")[: int(np.isfinite(score).sum())]
        chosen = _best_apart(contacts, best, settings.triples)
        rest = order[first + _AT_ONCE :]
        if len(chosen) == settings.triples and len(rest) and score[chosen[-1]] >= _ENOUGH - risk[rest[0]]:
            break
    return chosen


@njit
def _best_apart(contacts: Array, order: Index, count: int) -> Index:
    """Return the first of triples (K, N, 3) in an order, without those nearly the same as one before."""
    chosen, n = np.empty(count, np.int64), 0
    for k in order:
        near = False
        for m in range(n):
            total = 0.0
            for i in range(contacts.shape[1]):
                squared = 0.0
                for c in range(3):
                    squared += (contacts[k, i, c] - contacts[chosen[m], i, c]) ** 2
                total += np.sqrt(squared)
            if total < contacts.shape[1] * _APART:
                near = True
                break
        if not near:
            chosen[n] = k
            n += 1
            if n == count:
                break
    return chosen[:n]


def best_shared(triples: NDArray[np.integer[Any]], score: Array, count: int) -> Index:
    """Return the best of triples or pairs (K, N) of sampled points, but no point more often than its share.

    Points lie farther apart than `most_robust` looks: without shares one good point would be in most triples.
    """
    used = np.zeros(int(triples.max()) + 1, dtype=int)
    limit = max(4, 6 * count // len(used))
    chosen: list[int] = []
    for k in np.argsort(-score, kind="stable"):
        if (used[triples[k]] < limit).all():
            used[triples[k]] += 1
            chosen.append(int(k))
            if len(chosen) == count:
                break
    return np.array(chosen, dtype=np.int64)
