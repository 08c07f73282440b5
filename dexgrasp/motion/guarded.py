"""Closing until contact, then pressing with the planned forces: execution that feels through the joints.

What perception sees is a few millimetres off, and position servos turn millimetres into newtons. So each finger closes
until it lags behind its set-point, and the squeeze follows the joints: set-point = measured position + torque / kp
presses with that torque wherever the surface is, and while the object gives way to it. The torque is J^T f at the
contact points; the robot bears its own weight by itself. Only joint positions are used, which every observation mode
has.
"""

import numpy as np

from dexgrasp.grasp.grasp import Grasp
from dexgrasp.grasp.script import ActionScript
from dexgrasp.kinematics.forward import body_frames, fingertips, tip_jacobian
from dexgrasp.kinematics.tree import RobotTree
from dexgrasp.motion.motion import Motion
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.limits import HAND_STIFFNESS, HAND_TORQUE
from dexgrasp_env.robot.names import FINGER_COLUMNS, GRASP_FINGERS
from dexgrasp_env.scene.constants import CONTROL_PERIOD

COLUMNS = [FINGER_COLUMNS[finger] for finger in GRASP_FINGERS]
_TOUCH_LAG = 0.0018  # m that a tip stays behind its set-point when it has touched: about 2 N
_CLOSE_SPEED = 0.03  # m/s of the tips
_OVERTRAVEL = 0.016  # m past where the surface is believed to be
_CLOSE_STEPS, _SETTLE_STEPS = 60, 3  # control steps at most, and after contact
_RAMP_STEPS, _SQUEEZE_STEPS = 8, 16  # control steps until the torque is asked for in full, and until the lift
_GAIN = 0.6  # of the way to the wanted torque, per control step: less than 1, as the joints move on meanwhile
_TIP_DEPTH = 0.0105  # m from a tip's centre to where it touches


class GuardedGrasp(Motion):
    """Takes hold with feedback from the joint positions: approach, close, squeeze.

    Attributes:
        script, grasp, tree: see `__init__`.
        targets: (23,) rad, the last set-points of the fingers.
        spans: (2,) m, distances of index and middle tip from the thumb's at the end.
    """

    def __init__(self, script: ActionScript, grasp: Grasp, tree: RobotTree) -> None:
        """Prepare.

        Args:
            script: whose approach is followed; from the close on feedback replaces its fingers.
            grasp: with the forces to press with.
            tree: the robot.
        """
        self.script, self.grasp, self.tree = script, grasp, tree
        first = dict(script.phases)
        self._approach_end = first["close"]
        self._open = script.targets[self._approach_end - 1] if self._approach_end else script.targets[0]
        self._closed = script.targets[first["squeeze"] - 1]
        way = fingertips(self._closed, tree) - fingertips(self._open, tree)
        self._travel = np.maximum(np.linalg.norm(way, axis=1), 1e-3)  # m of the tips
        self._progress, self._touched = np.zeros(3), np.zeros(3, bool)
        self._step = self._close_count = self._settled = self._squeeze_count = 0
        self.targets, self.spans = self._open.copy(), np.zeros(2)

    @property
    def done(self) -> bool:
        """Whether the hand has the object."""
        return self._squeeze_count >= _SQUEEZE_STEPS

    def _next(self, q: Array) -> Array:
        if self._step < self._approach_end:
            self._step += 1
            return self.script.targets[self._step - 1]
        return self._close(q) if self._settled <= _SETTLE_STEPS else self._squeeze(q)

    def _close(self, q: Array) -> Array:
        self._close_count += 1
        behind = fingertips(self.targets, self.tree) - fingertips(q, self.tree)
        lag = -(behind * self.grasp.normals).sum(1)
        self._touched |= (lag > _TOUCH_LAG) & (self._progress > 0.3)
        limit = 1.0 + _OVERTRAVEL / self._travel
        moving = ~self._touched & (self._progress < limit)
        self._progress[moving] += _CLOSE_SPEED * CONTROL_PERIOD / self._travel[moving]
        self._progress = np.minimum(self._progress, limit)
        for finger, columns in enumerate(COLUMNS):
            way = self._closed[columns] - self._open[columns]
            self.targets[columns] = self._open[columns] + self._progress[finger] * way
        # A joint cannot follow beyond its range, and what lags there has touched nothing.
        self.targets = np.clip(self.targets, self.tree.lower, self.tree.upper)
        if not moving.any() or self._close_count >= _CLOSE_STEPS:
            self._settled += 1
        return self.targets

    def _squeeze(self, q: Array) -> Array:
        self._squeeze_count += 1
        torques = pressing_torques(q, self.grasp.normals, self.grasp.forces, self.tree)
        lag = min(1.0, self._squeeze_count / _RAMP_STEPS) * torques / HAND_STIFFNESS
        self.targets = self.targets.copy()
        for columns in COLUMNS:
            self.targets[columns] += _GAIN * (q + lag - self.targets)[columns]
        self.targets = np.clip(self.targets, self.tree.lower, self.tree.upper)
        if self.done:
            self.spans = tip_spans(q, self.tree)
        return self.targets


def pressing_torques(q: Array, normals: Array, forces: Array, tree: RobotTree) -> Array:
    """Return the torques (23,) Nm with which fingers at `q` (23,) press with forces (3, 3) N; 0 for the arm."""
    frames = body_frames(q, tree)
    J = tip_jacobian(tree, frames, fingertips(q, tree) - _TIP_DEPTH * normals)[:, :, 7:]
    torque = np.einsum("frj,fr->j", J, forces)
    return np.concatenate([np.zeros(7), np.clip(torque, -HAND_TORQUE, HAND_TORQUE)])


def tip_spans(q: Array, tree: RobotTree) -> Array:
    """Return the distances (2,) m of index and middle tip from the thumb's."""
    thumb, *fingers = fingertips(q, tree)
    return np.linalg.norm(np.array(fingers) - thumb, axis=1)
