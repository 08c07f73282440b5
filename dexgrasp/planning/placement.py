"""A proposal put on the hand's atlas: the posture whose tips fit best, and where its palm then is."""

from itertools import permutations
from typing import NamedTuple

import numpy as np

from dexgrasp.geometry.convex_kernel import Obstacle, convex_distance
from dexgrasp.geometry.triangle import cross
from dexgrasp.mechanics.cones import basis_of
from dexgrasp.mechanics.kinematics.forward import to_world
from dexgrasp.planning.atlas import Tips, hand_atlas, triangle_sides
from dexgrasp.planning.settings import GraspProblem
from dexgrasp_env.arrays import AnyArray, Array, Index
from dexgrasp_env.compiled import leaf, njit

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


@njit
def _frame(triangle: Array, out: Array) -> None:
    """Write axes (3, 3) as columns of a triangle's own frame: along its first side, in it, and out of it."""
    across = np.empty(3)
    for r in range(3):
        out[r, 0], across[r] = triangle[1, r] - triangle[0, r], triangle[2, r] - triangle[0, r]
    _unit(out, 0)
    cross(out[:, 0], across, out[:, 2])
    _unit(out, 2)
    cross(out[:, 2], out[:, 0], out[:, 1])


@leaf
def _third(points: Array, way: Array, out: Array) -> None:
    """Write a triangle (3, 3): the first three points, or two and one on the way (3,) from the first."""
    for r in range(3):
        out[0, r], out[1, r] = points[0, r], points[1, r]
        out[2, r] = points[2, r] if len(points) > 2 else points[0, r] + way[r]


@njit
def _across(points: Array, turn: float) -> Array:
    """Return a direction (3,) across the line of two points, turned by `turn` rad about it."""
    line = points[1] - points[0]
    line /= np.sqrt((line * line).sum()) + 1e-12
    ax, ay, az, bx, by, bz = basis_of(line[0], line[1], line[2])
    c, s = np.cos(turn), np.sin(turn)
    return np.array([c * ax + s * bx, c * ay + s * by, c * az + s * bz])


@leaf
def _unit(columns: Array, k: int) -> None:
    size = np.sqrt(columns[0, k] ** 2 + columns[1, k] ** 2 + columns[2, k] ** 2) + 1e-12
    for r in range(3):
        columns[r, k] /= size


@leaf
def _align(goal: Array, goal_frame: Array, tips: Array, tip_frame: Array, R: Array, p: Array) -> None:
    """Write the rotation (3, 3) and shift (3,) that put the first n tips on their goals (n, 3), middle on middle."""
    n = goal.shape[0]
    for r in range(3):
        p[r] = goal[0, r] + goal[1, r]
        if n > 2:
            p[r] += goal[2, r]
        p[r] /= n
        for c in range(3):
            R[r, c] = 0.0
            for k in range(3):
                R[r, c] += goal_frame[r, k] * tip_frame[c, k]
    for r in range(3):
        for c in range(3):
            total = tips[0, c] + tips[1, c]
            if n > 2:
                total += tips[2, c]
            p[r] -= R[r, c] * total / n


@leaf
def _facing(inward: Array, posture: Tips, R: Array) -> float:
    """Return the squareness of the tips to where they press; -1 where one would touch with its back."""
    facing = 2.0
    for i in range(len(inward)):
        on_axis, on_pad = 0.0, 0.0
        for r in range(3):
            local = R[0, r] * inward[i, 0] + R[1, r] * inward[i, 1] + R[2, r] * inward[i, 2]
            on_axis += posture.axes[i, r] * local
            on_pad += posture.pads[i, r] * local
        if on_axis < posture.least or on_pad < -0.1:
            return -1.0
        facing = min(facing, 0.5 * on_axis + on_pad)
    return facing


@leaf
def _score(
    inward: Array, posture: Tips, R: Array, p: Array, obstacle: Obstacle, room: Array, height: float
) -> float:
    """Score an aligned posture, -1 if useless; what costs most is asked last.

    `room` is (3, 3): two rows to work in, and the middle of the palm's box in the palm frame, m. Further tips
    should be near the surface: `height` m from it.
    """
    palm, gradient = room[0], room[1]
    to_world(R, p, room[2], palm)
    # Down is best: the arm reaches it everywhere. Sideways is fine, palm up is not.
    down, top = -R[2, 0], palm[2]
    if palm[2] < _PALM_HEIGHT or down < -0.2:
        return -1.0
    facing = _facing(inward, posture, R)
    if facing <= -1.0 or convex_distance(palm, obstacle, gradient, _PALM_ROOM) < _PALM_ROOM:
        return -1.0
    miss = 0.0
    for i in range(len(inward), len(posture.centres)):
        to_world(R, p, posture.centres[i], palm)
        miss += abs(convex_distance(palm, obstacle, gradient, np.inf) - height)
    return min(facing, 0.8) + 0.5 * down + 2.0 * min(top, 0.15) - _REACH * miss


@njit
def _useful(
    goals: Goals, near: Index, tips: Tips, obstacle: Obstacle, palm: Array, height: float
) -> Placements:
    """Put on each of K assigned triples those of its neighbours in the atlas, `near` (K, n), that will do."""
    K, most = near.shape
    triple, which = np.empty(K * most, dtype=np.int64), np.empty(K * most, dtype=np.int64)
    scores, rotations, positions = np.empty(K * most), np.empty((K * most, 3, 3)), np.empty((K * most, 3))
    goal_frame, tip_frame, room = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    corners, pair, away = np.empty((3, 3)), goals.centres.shape[1] == 2, np.zeros(3)
    room[2] = palm
    m = 0
    for k in range(K):
        for rank, n in enumerate(near[k]):
            if n >= tips.centres.shape[0]:
                break
            if rank == 0 or pair:
                if pair:  # each neighbour at another turn about the line of both
                    away = _across(goals.centres[k], 2.0 * np.pi * rank / most)
                _third(goals.centres[k], away, corners)
                _frame(corners, goal_frame)
            R, p = rotations[m], positions[m]
            _third(tips.centres[n], tips.axes[n, 0] + tips.axes[n, 1], corners)
            _frame(corners, tip_frame)
            _align(goals.centres[k], goal_frame, tips.centres[n], tip_frame, R, p)
            posture = Tips(tips.centres[n], tips.axes[n], tips.pads[n], tips.least)
            score = _score(goals.inward[k], posture, R, p, obstacle, room, height)
            if score > 0.0:
                triple[m], which[m], scores[m] = k, n, score
                m += 1
    return Placements(goals, triple[:m], scores[:m], which[:m], rotations[:m], positions[:m])


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
    atlas, height = hand_atlas(problem.cell), problem.settings.tip_height
    centres = (contacts + height * normals)[:, orders].reshape(-1, orders.shape[1], 3)
    inward = -normals[:, orders].reshape(centres.shape)
    goals = Goals(np.ascontiguousarray(centres), np.ascontiguousarray(inward))
    _, near = atlas.search.query(triangle_sides(centres), neighbours, distance_upper_bound=SIDE_TOLERANCE)
    obstacle = problem.target.everything.obstacle
    return _useful(goals, near, atlas.tips, obstacle, problem.tree.palm_middle, height)
