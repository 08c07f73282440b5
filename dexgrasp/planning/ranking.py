"""Which contacts bear errors best: one ranking, for proposals of every source and for feasible configurations."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp.physics.margin import margins_to
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.shape.target import GraspTarget
from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.compiled import njit

_ENOUGH = 0.7  # closure margin from where more is no merit
_ROUGH = 1e-3  # of the closure margins that are ranked by
_AT_ONCE = 48  # triples whose margins are computed together
_APART = 0.006  # m, mean distance of the fingertips of two triples that are not the same


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
    extremes = target.distance.triangles.reshape(-1, 3)
    size, height = float(np.linalg.norm(np.ptp(extremes, axis=0))), float(extremes[:, 2].max())
    offset = np.linalg.norm(contacts.mean(1) - target.centre, axis=1) / size
    uneven = np.abs(contacts[:, :, 2] - target.centre[2]).max(1) / height
    return offset + uneven + np.maximum(normals[:, :, 2], 0.0).max(1)


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
        rest = order[first + _AT_ONCE : first + _AT_ONCE + 1]
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
