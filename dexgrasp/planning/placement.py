"""A proposal put on the hand's atlas: the posture whose tips fit best, and where its palm then is."""

from itertools import permutations
from typing import NamedTuple

import numpy as np

from dexgrasp.mechanics.cones import tangent_basis
from dexgrasp.planning.atlas import Tips, hand_atlas, triangle_frames, triangle_sides
from dexgrasp.planning.settings import GraspProblem
from dexgrasp_env.arrays import AnyArray, Array, Index, unit

NEIGHBOURS = 16
"""Postures of the atlas that the dataset looks at for each assignment; a planner's are its setting."""
SIDE_TOLERANCE = 0.012
"""m, distance in the sides of the fingertips' triangle within which a posture is a neighbour."""
_REACH = 4.0  # of score, that a further tip costs for each m from the surface
_PALM_ROOM = 0.028  # m from the palm's centre to the object: half its thickness and some
_PALM_HEIGHT = 0.06  # m of the palm's centre above the table


def assignments(count: int) -> Index:
    """Return the orders (A, count) in which fingers can take contacts; the first leaves them as they are."""
    return np.array(list(permutations(range(count))))


class Goals(NamedTuple):
    """Goals of the first two or three fingertips: K places, or one."""

    centres: Array  # (K, n, 3) m, tip centres, world frame
    inward: Array  # (K, n, 3) into the object


class Placements(NamedTuple):
    """M postures of the atlas put on assigned triples; those of one triple follow each other."""

    goals: Goals  # K of them
    triple: Index  # (M,) which goal
    scores: Array  # (M,) above 0
    which: Index  # (M,) posture of the atlas
    rotations: Array  # (M, 3, 3) of the palm frame
    positions: Array  # (M, 3) m

    def best(self) -> "Placements":
        """Return the placement with the highest score of each triple that has any."""
        order = np.lexsort((-self.scores, self.triple))
        first = order[np.diff(self.triple[order], prepend=-1) > 0]
        return self.select(first)

    def select(self, rows: AnyArray) -> "Placements":
        """Return the placements of a mask or of indices."""
        return Placements._make([self.goals, *(each[rows] for each in self[1:])])


def _goal_frames(centres: Array, triple: Index, turns: Array) -> Array:
    """Return `triangle_frames` (M, 3, 3) of M goals, the indices `triple` of K; of pairs turned by (M,) rad."""
    if centres.shape[1] > 2:
        return triangle_frames(centres, centres[:, 0])[triple]
    t1, t2 = tangent_basis(unit(centres[:, 1] - centres[:, 0]))
    across = np.cos(turns)[:, None] * t1[triple] + np.sin(turns)[:, None] * t2[triple]
    return triangle_frames(centres[triple], across)


def place_on_atlas(
    contacts: Array, normals: Array, problem: GraspProblem, orders: Index, neighbours: int = NEIGHBOURS
) -> Placements:
    """Put hand postures on contacts: a neighbour search by triangle, and one rigid alignment each.

    Args:
        contacts: (K, n, 3) m.
        normals: (K, n, 3) out of the object.
        problem: the object; of the settings how deep the tips are to be.
        orders: (A, n) rows of `assignments`: which contact the first n fingers take.
        neighbours: postures of the atlas looked at for each.

    Returns:
        What will do; goal A k + a is triple k in order a.
    """
    atlas, height, n = hand_atlas(problem.cell), problem.settings.tip_height, orders.shape[1]
    centres = (contacts + height * normals)[:, orders].reshape(-1, n, 3)
    inward = -normals[:, orders].reshape(centres.shape)
    goals = Goals(np.ascontiguousarray(centres), np.ascontiguousarray(inward))
    _, near = atlas.search.query(triangle_sides(centres), neighbours, distance_upper_bound=SIDE_TOLERANCE)
    triple, rank = np.nonzero(near < len(atlas.joints))
    which = near[triple, rank]
    # Of a pair, each neighbour is at another turn about the line of both.
    frames = _goal_frames(centres, triple, 2.0 * np.pi * rank / neighbours)
    R = frames @ atlas.frames[which].transpose(0, 2, 1)
    p = centres.mean(1)[triple] - (R @ atlas.middles[which][..., None])[..., 0]
    placed = Placements(goals, triple, np.zeros(len(which)), which, R, p)
    return _scored(placed, atlas.tips, problem)


def _scored(placed: Placements, tips: Tips, problem: GraspProblem) -> Placements:
    """Return the placements that are of use, with their scores; what costs most is asked last.

    Further tips should be near the surface.
    """
    object_distance = problem.target.everything.distance
    # Down is best: the arm reaches it everywhere. Sideways is fine, palm up is not.
    palms, down = placed.positions + placed.rotations @ problem.tree.palm_middle, -placed.rotations[:, 2, 0]
    kept = np.flatnonzero((palms[:, 2] >= _PALM_HEIGHT) & (down >= -0.2))
    placed, palms, down = placed.select(kept), palms[kept], down[kept]
    local, n = placed.goals.inward[placed.triple] @ placed.rotations, placed.goals.inward.shape[1]
    on_axis, on_pad = (
        np.einsum("mik,mik->mi", way[placed.which, :n], local) for way in (tips.axes, tips.pads)
    )
    square = np.minimum((0.5 * on_axis + on_pad).min(1), 0.8)
    kept = np.flatnonzero((on_axis >= tips.least).all(1) & (on_pad >= -0.1).all(1))
    kept = kept[object_distance(palms[kept]) >= _PALM_ROOM]
    placed, palms = placed.select(kept), palms[kept]
    further = tips.centres[placed.which, n:] @ placed.rotations.transpose(0, 2, 1) + placed.positions[:, None]
    off = object_distance(further).reshape(further.shape[:2]) - problem.settings.tip_height
    scores = (
        square[kept] + 0.5 * down[kept] + 2.0 * np.minimum(palms[:, 2], 0.15) - _REACH * np.abs(off).sum(1)
    )
    return placed._replace(scores=scores).select(scores > 0.0)
