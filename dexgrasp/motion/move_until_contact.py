"""Closing until contact, then pressing with the planned forces: execution that feels through the joints.

What perception sees is a few millimetres off, and position servos turn millimetres into newtons. So each finger closes
until it lags behind its set-point, and the squeeze follows the joints: set-point = measured position + torque / kp
presses with that torque wherever the surface is, and while the object gives way to it. The torque is J^T f at the
contact points; the robot bears its own weight by itself. Only joint positions are used, which every observation mode
has.
"""

import numpy as np

from dexgrasp.grasp.grasp import Grasp
from dexgrasp.grasp.trajectory import ActionScript
from dexgrasp.mechanics.kinematics.forward import fingertips, follow, hand_contact_jacobian
from dexgrasp.mechanics.kinematics.tree import RobotTree, robot_tree
from dexgrasp.motion.motion import Motion
from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.scene.constants import CONTROL_PERIOD

TIP_DEPTH = 0.75  # of a tip's radius: how far from its centre it touches
_SPEED = 0.03  # m/s of closing tips
_BRISK = 0.04  # s that servos may stay behind: slower ones lag more without a touch


class GuardedGrasp(Motion):
    """Takes hold with feedback from the joint positions: approach, close, squeeze.

    Attributes:
        script, grasp, tree: see `__init__`.
        targets: (n,) rad, the last set-points of the fingers.
        spans: (g - 1,) m, distances of the other tips from the opposing one's at the end.
    """

    def __init__(
        self, script: ActionScript, grasp: Grasp, overtravel: float = 0.016, pace: float = 1.0
    ) -> None:
        """Prepare.

        Args:
            script: whose approach is followed; from the close on feedback replaces its fingers.
            grasp: with the forces to press with.
            overtravel: m that tips close past where the surface is believed to be.
            pace: share of the usual speed of closing, and of the lag that counts as a touch. Below 1 a lag to any side
                is one, at once: an edge, or a surface where none was seen, is not pressed until it gives way.
        """
        self._overtravel, self._pace = overtravel, pace
        self.script, self.grasp, self.tree = script, grasp, robot_tree(grasp.cell)
        self._approach, self._closed = script.phases["approach"], script.phases["close"][-1]
        self._open = self._approach[-1]
        way = fingertips(self._closed, self.tree) - fingertips(self._open, self.tree)
        self._travel = np.maximum(np.linalg.norm(way, axis=1), 1e-3)  # m of the tips
        self._progress, self._touched = np.zeros(len(way)), np.zeros(len(way), bool)
        self._finger = finger_of_joints(self.tree)
        slow = [max(self.tree.response[first:end].max() - _BRISK, 0.0) for first, end in self.tree.fingers]
        # m that a tip stays behind its set-point when it has touched: about 2 N
        self._lag = self._pace * (0.0018 + _SPEED * np.array(slow))
        self._step = self._close_count = self._settled = self._squeeze_count = 0
        self.targets, self.spans = self._open.copy(), np.zeros(len(way) - 1)

    @property
    def done(self) -> bool:
        """True once the hand has the object."""
        return self._squeeze_count >= 16  # control steps

    def _next(self, q: Array) -> Array:
        if self._step < len(self._approach):
            self._step += 1
            return self._approach[self._step - 1]
        return self._close(q) if self._settled <= 3 else self._press(q)

    def _close(self, q: Array) -> Array:
        self._close_count += 1
        behind = fingertips(self.targets, self.tree) - fingertips(q, self.tree)
        lag = -(behind * self.grasp.normals).sum(1)
        begun = self._progress > 0.3
        if self._pace < 1.0:
            lag, begun = np.linalg.norm(behind, axis=1), np.ones_like(begun)
        self._touched |= (lag > self._lag) & begun
        limit = 1.0 + self._overtravel / self._travel
        moving = ~self._touched & (self._progress < limit)
        self._progress[moving] += self._pace * _SPEED * CONTROL_PERIOD / self._travel[moving]
        self._progress = np.minimum(self._progress, limit)
        share = np.append(self._progress, 0.0)[self._finger]
        # A joint cannot follow beyond its range, and what lags there has touched nothing.
        self.targets = within_range(self._open + share * (self._closed - self._open), self.tree)
        if not moving.any() or self._pace * self._close_count >= 60:
            self._settled += 1
        return self.targets

    def _press(self, q: Array) -> Array:
        self._squeeze_count += 1
        torques = pressing_torques(q, self.grasp.normals, self.grasp.forces, self.tree)
        lag = lag_of(min(1.0, self._squeeze_count / 8) * torques, self.tree)
        # of the way to the wanted torque, per control step: less than 1, as the joints move on meanwhile
        targets = self.targets + 0.6 * (self._finger >= 0) * (q + lag - self.targets)
        self.targets = within_range(targets, self.tree)
        if self.done:
            self.spans = tip_spans(q, self.tree)
        return self.targets


def finger_of_joints(tree: RobotTree) -> Index:
    """Return which of the grasping fingers each joint (n,) is of, -1 for the others."""
    found = np.full(len(tree.lower), -1)
    for finger, (first, end) in enumerate(tree.fingers):
        found[first:end] = finger
    return found


def within_range(q: Array, tree: RobotTree) -> Array:
    """Return set-points (n,) rad within the joint range, those that follow others where these have them."""
    inside = np.clip(q, tree.lower, tree.upper)
    follow(inside, tree)
    return inside


def lag_of(torques: Array, tree: RobotTree) -> Array:
    """Return how far set-points are ahead of joints that press with torques (n,) Nm, rad; 0 for the arm."""
    lag = np.zeros_like(torques)
    lag[tree.arm :] = torques[tree.arm :] / tree.stiffness
    return lag


def pressing_torques(q: Array, normals: Array, forces: Array, tree: RobotTree) -> Array:
    """Return the torques (n,) Nm with which fingers at `q` (n,) press with forces (g, c) N; 0 for the arm."""
    points = fingertips(q, tree) - TIP_DEPTH * tree.tip_radius * normals
    torque = np.einsum("frj,fr->j", hand_contact_jacobian(q, points, normals, tree), forces)
    return np.append(np.zeros(tree.arm), np.clip(torque, -tree.torque, tree.torque))


def tip_spans(q: Array, tree: RobotTree) -> Array:
    """Return the distances (g - 1,) m of the other tips from the opposing one's."""
    thumb, *fingers = fingertips(q, tree)
    return np.linalg.norm(np.array(fingers) - thumb, axis=1)
