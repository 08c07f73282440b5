"""A proposal put on the hand's atlas: the posture whose tips fit best, and where its palm then is."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from agents.geometry.convex_kernel import Obstacle, convex_distance
from agents.planning.atlas import hand_atlas, triangle_sides
from agents.planning.settings import PlannerSettings
from dexgrasp_env.arrays import Array

ASSIGNMENTS = np.array([[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]])
"""Orders in which thumb, index and middle can take three contacts; the first leaves them as they are."""
NEIGHBOURS = 16
"""Postures of the atlas that the dataset looks at for each assignment; a planner's are its setting."""
SIDE_TOLERANCE = 0.012
"""m, distance in the sides of the fingertips' triangle within which a posture is a neighbour."""
_PALM_CENTRE = np.array([-0.0093, 0.0, -0.0475])  # of the palm's box in the palm frame, m
_PALM_ROOM = 0.028  # m from the palm's centre to the object: half its thickness and some
_PALM_HEIGHT = 0.06  # m of the palm's centre above the table


class Goals(NamedTuple):
    """Where fingertips are to go: K triples, or one."""

    centres: Array  # (K, 3, 3) m, tip centres of thumb, index, middle, robot base frame
    inward: Array  # (K, 3, 3) into the object


class Tips(NamedTuple):
    """Fingertips of N postures, or of one, in the palm frame; see `HandAtlas`."""

    centres: Array  # (N, 3, 3) m
    axes: Array  # (N, 3, 3)
    pads: Array  # (N, 3, 3)


class Placements(NamedTuple):
    """M postures of the atlas put on assigned triples; those of one triple follow each other."""

    goals: Goals  # K of them
    triple: NDArray[np.int64]  # (M,) which goal
    scores: Array  # (M,) above 0
    which: NDArray[np.int64]  # (M,) posture of the atlas
    rotations: Array  # (M, 3, 3) of the palm frame
    positions: Array  # (M, 3) m

    def best(self) -> NDArray[np.int64]:
        """Return the index of the placement with the highest score of each triple that has any."""
        order = np.lexsort((-self.scores, self.triple))
        first = np.diff(self.triple[order], prepend=-1) > 0
        return order[first]


@njit(cache=True, error_model="numpy")
def _frame(a: Array, b: Array, c: Array) -> Array:
    """Return axes (3, 3) as columns of a triangle's own frame."""
    x = b - a
    x /= np.sqrt((x * x).sum()) + 1e-12
    z = np.cross(x, c - a)
    z /= np.sqrt((z * z).sum()) + 1e-12
    y = np.cross(z, x)
    out = np.empty((3, 3))
    out[:, 0], out[:, 1], out[:, 2] = x, y, z
    return out


@njit(cache=True, error_model="numpy")
def _place(goal: Goals, posture: Tips, obstacle: Obstacle) -> tuple[float, Array, Array]:
    """Align a posture with fingertip targets; return its score (-1 if useless), palm rotation and position."""
    centres, tips = goal.centres, posture.centres
    R = _frame(centres[0], centres[1], centres[2]) @ np.ascontiguousarray(_frame(tips[0], tips[1], tips[2]).T)
    middle, own = np.zeros(3), np.zeros(3)
    for i in range(3):
        middle += centres[i] / 3.0
        own += tips[i] / 3.0
    p = middle - R @ own
    palm = p + R @ _PALM_CENTRE
    if palm[2] < _PALM_HEIGHT:
        return -1.0, R, p
    facing = 2.0
    for i in range(3):
        on_axis, on_pad = 0.0, 0.0
        local = R.T @ goal.inward[i]
        for r in range(3):
            on_axis += posture.axes[i, r] * local[r]
            on_pad += posture.pads[i, r] * local[r]
        if on_axis < 0.05 or on_pad < -0.1:
            return -1.0, R, p
        facing = min(facing, 0.5 * on_axis + on_pad)
    gradient = np.empty(3)
    room = convex_distance(palm, obstacle, gradient)
    if room < _PALM_ROOM:
        return -1.0, R, p
    # Down is best: the arm reaches it everywhere. Sideways is fine, palm up is not.
    down = -R[2, 0]
    if down < -0.2:
        return -1.0, R, p
    return min(facing, 0.8) + 0.5 * down + 2.0 * min(palm[2], 0.15), R, p


@njit(cache=True, error_model="numpy")
def _useful(goals: Goals, near: NDArray[np.int64], tips: Tips, obstacle: Obstacle) -> Placements:
    """Put on each of K assigned triples those of its neighbours in the atlas, `near` (K, n), that will do."""
    K, most = near.shape
    triple, which = np.empty(K * most, dtype=np.int64), np.empty(K * most, dtype=np.int64)
    scores, rotations, positions = np.empty(K * most), np.empty((K * most, 3, 3)), np.empty((K * most, 3))
    m = 0
    for k in range(K):
        goal = Goals(goals.centres[k], goals.inward[k])
        for n in near[k]:
            if n >= tips.centres.shape[0]:
                break
            score, R, p = _place(goal, Tips(tips.centres[n], tips.axes[n], tips.pads[n]), obstacle)
            if score > 0.0:
                triple[m], which[m], scores[m], rotations[m], positions[m] = k, n, score, R, p
                m += 1
    return Placements(goals, triple[:m], scores[:m], which[:m], rotations[:m], positions[:m])


def place_on_atlas(
    contacts: Array,
    normals: Array,
    obstacle: Obstacle,
    settings: PlannerSettings,
    orders: NDArray[np.int64],
    neighbours: int = NEIGHBOURS,
) -> Placements:
    """Put hand postures on contact triples: a neighbour search by triangle, and one rigid alignment each.

    Args:
        contacts: (K, 3, 3) m.
        normals: (K, 3, 3) out of the object.
        obstacle: the object.
        settings: how deep the tips are to be.
        orders: (A, 3) rows of `ASSIGNMENTS`: which contact thumb, index and middle take.
        neighbours: postures of the atlas looked at for each.

    Returns:
        What will do; goal A k + a is triple k in order a.
    """
    atlas = hand_atlas()
    centres = (contacts + settings.tip_height * normals)[:, orders].reshape(-1, 3, 3)
    inward = -normals[:, orders].reshape(-1, 3, 3)
    goals = Goals(np.ascontiguousarray(centres), np.ascontiguousarray(inward))
    _, near = atlas.search.query(triangle_sides(centres), neighbours, distance_upper_bound=SIDE_TOLERANCE)
    return _useful(goals, near, Tips(atlas.tips, atlas.axes, atlas.pads), obstacle)
