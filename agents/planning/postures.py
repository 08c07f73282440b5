"""Proposals to whole configurations: starting postures for the optimiser.

Two ways. The atlas finds hand postures whose tips make the proposal's triangle and places the palm by rigid alignment.
The way of section 3.3 starts from a palm above the object in six orientations and moves the tips by IK.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from agents.geometry.convex_kernel import Obstacle, convex_distance
from agents.grasp.target import GraspTarget
from agents.kinematics.forward import empty_frames, forward, tip_jacobian, tip_positions
from agents.kinematics.palm_ik import solve_palm
from agents.kinematics.tip_ik import solve_tips
from agents.kinematics.tree import RobotTree
from agents.planning.atlas import HandAtlas, hand_atlas, triangle_sides
from agents.planning.proposals import Proposals
from agents.planning.settings import PlannerSettings
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.limits import HOME

_ASSIGNMENTS = np.array([[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]])
_NEIGHBOURS = 16  # postures of the atlas looked at for each assignment
_SIDE_TOLERANCE = 0.012  # m
_PALM_CENTRE = np.array([-0.0093, 0.0, -0.0475])  # of the palm's box in the palm frame, m
_PALM_ROOM = 0.028  # m from the palm's centre to the object: half its thickness and some
_PALM_HEIGHT = 0.06  # m of the palm's centre above the table
_ARM_TOLERANCE = 2e-3  # m
_REACH_ATTEMPTS = 4  # arm solutions attempted for a posture that is asked for
_JOINT_TORQUE = 0.7  # Nm
_STRONG = 18.0  # N of the thumb, from where more strength is no merit


@dataclass(frozen=True)
class Posture:
    """A start for the optimiser: joints (23,) rad, the proposal it came from, and its score."""

    q: Array
    proposal: int
    score: float


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
    """Postures of the atlas put on K triples."""

    scores: Array  # (K,), -1 where none will do
    which: NDArray[np.int64]  # (K,) posture of the atlas
    rotations: Array  # (K, 3, 3) of the palm frame
    positions: Array  # (K, 3) m


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
def _best_placements(goals: Goals, near: NDArray[np.int64], tips: Tips, obstacle: Obstacle) -> Placements:
    """Put on each of K assigned triples the best of its neighbours in the atlas, `near` (K, n)."""
    K = goals.centres.shape[0]
    best = Placements(np.full(K, -1.0), np.zeros(K, dtype=np.int64), np.zeros((K, 3, 3)), np.zeros((K, 3)))
    for k in range(K):
        goal = Goals(goals.centres[k], goals.inward[k])
        for n in near[k]:
            if n >= tips.centres.shape[0]:
                break
            score, R, p = _place(goal, Tips(tips.centres[n], tips.axes[n], tips.pads[n]), obstacle)
            if score > best.scores[k]:
                best.scores[k], best.which[k] = score, n
                best.rotations[k], best.positions[k] = R, p
    return best


def atlas_postures(
    proposals: Proposals, target: GraspTarget, tree: RobotTree, settings: PlannerSettings
) -> Iterator[Posture]:
    """Yield postures from the atlas, best first, with the arm solved; at most `settings.postures`."""
    atlas: HandAtlas = hand_atlas()
    reach = settings.tip_radius + 0.5 * sum(settings.distance)
    orders = _ASSIGNMENTS[:1] if proposals.assigned else _ASSIGNMENTS
    centres = np.ascontiguousarray(
        (proposals.contacts + reach * proposals.normals)[:, orders].reshape(-1, 3, 3)
    )
    inward = np.ascontiguousarray(-proposals.normals[:, orders].reshape(-1, 3, 3))
    _, near = atlas.search.query(triangle_sides(centres), _NEIGHBOURS, distance_upper_bound=_SIDE_TOLERANCE)
    tips = Tips(atlas.tips, atlas.axes, atlas.pads)
    scores, which, rotations, positions = _best_placements(
        Goals(centres, inward), near, tips, target.distance.obstacle
    )
    strength = _strengths(atlas.joints[which], rotations, inward, tree)
    margins = np.repeat(np.nan_to_num(proposals.margins, nan=0.3), len(orders))
    total = np.where(
        scores > 0.0, scores + np.minimum(margins, 0.5) + 2.0 * np.minimum(strength / _STRONG, 1.0), -np.inf
    )
    found = 0
    # Where the arm does not reach at all, it should not be asked about every posture there is.
    for k in np.argsort(-total, kind="stable")[: _REACH_ATTEMPTS * settings.postures]:
        if found == settings.postures or not np.isfinite(total[k]):
            return
        q = HOME.copy()
        q[7:] = atlas.joints[which[k]]
        if reach_palm(q, rotations[k], positions[k], tree):
            found += 1
            yield Posture(q, int(k) // len(orders), float(total[k]))


@njit(cache=True, error_model="numpy")
def _strengths(joints: Array, rotations: Array, inward: Array, tree: RobotTree) -> Array:
    """Force (K,) N that the thumb can press with, the two fingers half of it each, before a joint is at its limit."""
    K, frames = joints.shape[0], empty_frames(tree)
    out, q = np.empty(K), np.zeros(23)
    for k in range(K):
        q[7:] = joints[k]
        forward(q, tree, frames)
        palm = frames.R[tree.palm] @ tree.palm_rotation
        J = tip_jacobian(tree, frames, tip_positions(tree, frames))
        worst = 1e-9
        for i in range(3):
            direction = palm @ (rotations[k].T @ inward[k, i])
            torque = np.abs(direction @ np.ascontiguousarray(J[i, :, 7:])).max()
            worst = max(worst, torque if i == 0 else 0.5 * torque)
        out[k] = _JOINT_TORQUE / worst
    return out


_ELBOWS = ((0.0, 0.0), (0.0, 1.3), (0.0, -1.3), (0.5, 0.0), (-0.5, 0.0))


def reach_palm(q: Array, R: Array, p: Array, tree: RobotTree) -> bool:
    """Solve the arm's part of `q` for a palm pose, in place, from a few starts; tell whether it is reached."""
    toward = np.arctan2(p[1], p[0])
    for swing, twist in _ELBOWS:
        q[:7] = HOME[:7]
        q[0] = np.clip(toward + swing, tree.lower[0], tree.upper[0])
        q[6] = HOME[6] + twist
        if solve_palm(q, R, p, tree, 40, 1e-4) < _ARM_TOLERANCE:
            return True
    return False


def oriented_postures(
    proposal: int, proposals: Proposals, target: GraspTarget, tree: RobotTree, settings: PlannerSettings
) -> list[Posture]:
    """Return IK solutions for one proposal from palms above the object, turned in even steps (section 3.3)."""
    reach = settings.tip_radius + 0.5 * sum(settings.distance)
    targets = proposals.contacts[proposal] + reach * proposals.normals[proposal]
    top = target.hull.vertices[:, 2].max()
    postures = []
    for k in range(settings.initial_orientations):
        yaw = 2.0 * np.pi * k / settings.initial_orientations
        c, s = np.cos(yaw), np.sin(yaw)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ np.array(
            [[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]
        )
        middle = np.array([*targets.mean(0)[:2], top + 0.09])
        q = HOME.copy()
        if not reach_palm(q, R, middle + R @ np.array([0.0, 0.0, 0.03]), tree):
            continue
        miss = solve_tips(q, targets, tree, 60, 1e-3)
        postures.append(Posture(q, proposal, -float(miss)))
    return sorted(postures, key=lambda posture: -posture.score)
