"""Proposals to whole configurations: starting postures for the optimiser.

Two ways. The atlas finds hand postures whose tips make the proposal's triangle and places the palm by rigid alignment.
The way of section 3.3 starts from a palm above the object in six orientations and moves the tips by IK.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit

from agents.grasp.target import GraspTarget
from agents.kinematics.forward import empty_frames, forward, tip_jacobian, tip_positions
from agents.kinematics.palm_ik import reach_palm
from agents.kinematics.tip_ik import solve_tips
from agents.kinematics.tree import RobotTree
from agents.planning.atlas import hand_atlas
from agents.planning.placement import ASSIGNMENTS, place_on_atlas
from agents.planning.proposals import Proposals
from agents.planning.settings import PlannerSettings
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.limits import HAND_TORQUE, HOME

_REACH_ATTEMPTS = 4  # arm solutions attempted for a posture that is asked for
_JOINT_TORQUE = float(HAND_TORQUE.min())  # Nm
_STRONG = 18.0  # N of the thumb, from where more strength is no merit


@dataclass(frozen=True)
class Posture:
    """A start for the optimiser: joints (23,) rad, the proposal it came from, and its score."""

    q: Array
    proposal: int
    score: float


def atlas_postures(
    proposals: Proposals, target: GraspTarget, tree: RobotTree, settings: PlannerSettings
) -> Iterator[Posture]:
    """Yield postures from the atlas, best first, with the arm solved; at most `settings.postures`."""
    atlas = hand_atlas()
    orders = ASSIGNMENTS[:1] if proposals.assigned else ASSIGNMENTS
    placed = place_on_atlas(proposals.contacts, proposals.normals, target.distance.obstacle, settings, orders)
    joints = atlas.joints[placed.which]
    strength = _strengths(joints, placed.rotations, placed.goals.inward, tree)
    margins = np.repeat(np.nan_to_num(proposals.margins, nan=0.3), len(orders))
    total = placed.scores + np.minimum(margins, 0.5) + 2.0 * np.minimum(strength / _STRONG, 1.0)
    total[placed.scores <= 0.0] = -np.inf
    found = 0
    # Where the arm does not reach at all, it should not be asked about every posture there is.
    for k in np.argsort(-total, kind="stable")[: _REACH_ATTEMPTS * settings.postures]:
        if found == settings.postures or not np.isfinite(total[k]):
            return
        q = HOME.copy()
        q[7:] = joints[k]
        if reach_palm(q, placed.rotations[k], placed.positions[k], tree):
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


def oriented_postures(
    proposal: int, proposals: Proposals, target: GraspTarget, tree: RobotTree, settings: PlannerSettings
) -> list[Posture]:
    """Return IK solutions for one proposal from palms above the object, turned in even steps (section 3.3)."""
    targets = proposals.contacts[proposal] + settings.tip_height * proposals.normals[proposal]
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
