"""Which contacts bear errors best: one ranking, for proposals of every source and for feasible configurations."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.grasp.target import GraspTarget
from dexgrasp_env.arrays import Array

_ENOUGH = 0.7  # closure margin from where more is no merit
_APART = 0.006  # m, mean distance of the fingertips of two triples that are not the same


def robustness(contacts: Array, normals: Array, margins: Array, target: GraspTarget) -> Array:
    """Return how well K triples bear errors (K,), in units of closure margin: their margin, less `contact_sensitivity`.

    Args:
        contacts: (K, 3, 3) m.
        normals: (K, 3, 3) out of the object.
        margins: (K,) of force closure.
        target: the object.
    """
    return np.minimum(margins, _ENOUGH) - contact_sensitivity(contacts, normals, target)


def contact_sensitivity(contacts: Array, normals: Array, target: GraspTarget) -> Array:
    """Return what K triples (K, 3, 3) risk, in units of closure margin, if the surface is not quite where it was seen.

    Gravity turns contacts far from the centre of mass. A contact off the object's middle height, or whose normal points
    up, squeezes the object out of the hand if the true surface curves away.
    """
    size = float(np.linalg.norm(np.ptp(target.hull.vertices, axis=0)))
    height = float(target.hull.vertices[:, 2].max())
    offset = np.linalg.norm(contacts.mean(1) - target.centre, axis=1) / size
    uneven = np.abs(contacts[:, :, 2] - target.centre[2]).max(1) / height
    return offset + uneven + np.maximum(normals[:, :, 2], 0.0).max(1)


def best_apart(contacts: Array, score: Array, count: int) -> NDArray[np.int64]:
    """Return the best of triples (K, 3, 3) with contacts anywhere, without those nearly the same as a better one."""
    near, chosen = np.zeros(len(contacts), bool), []
    for k in np.argsort(-score, kind="stable"):
        if near[k]:
            continue
        chosen.append(int(k))
        if len(chosen) == count:
            break
        near |= np.linalg.norm(contacts - contacts[k], axis=-1).mean(1) < _APART
    return np.array(chosen, dtype=np.int64)


def best_shared(triples: NDArray[np.integer[Any]], score: Array, count: int) -> NDArray[np.int64]:
    """Return the best of triples (K, 3) of sampled points, but no point more often than its share.

    Points lie farther apart than `best_apart` looks: without shares one good point would be in most triples.
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
