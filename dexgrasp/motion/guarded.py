"""Closing until contact, then pressing with the planned forces: execution that feels through the joints.

What perception sees is a few millimetres off, and position servos turn millimetres into newtons. So each finger closes
until it lags behind its set-point, and the squeeze follows the joints: set-point = measured position + torque / kp
presses with that torque wherever the surface is, and while the object gives way to it. The torque is J^T f at the
contact points; the robot bears its own weight by itself. From the lift on the set-points stand still, but for a turn of
the object in the air, in which they go over to forces that hold it as it then is. Only joint positions are used, which
every observation mode has.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dexgrasp.kinematics.forward import body_frames, fingertips, tip_jacobian
from dexgrasp.kinematics.palm_ik import palm_frame
from dexgrasp.kinematics.tree import RobotTree
from dexgrasp.motion.script import ActionScript
from dexgrasp.motion.turn import Turn
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.limits import HAND_STIFFNESS, HAND_TORQUE
from dexgrasp_env.robot.names import FINGER_COLUMNS, GRASP_FINGERS
from dexgrasp_env.scene.constants import CONTROL_PERIOD
from dexgrasp_env.tasks.control import normalise

_COLUMNS = [FINGER_COLUMNS[finger] for finger in GRASP_FINGERS]
_TOUCH_LAG = 0.0018  # m that a tip stays behind its set-point when it has touched: about 2 N
_CLOSE_SPEED = 0.03  # m/s of the tips
_OVERTRAVEL = 0.016  # m past where the surface is believed to be
_CLOSE_STEPS, _SETTLE_STEPS = 60, 3  # control steps at most, and after contact
_RAMP_STEPS, _SQUEEZE_STEPS = 8, 16  # control steps until the torque is asked for in full, and until the lift
_GAIN = 0.6  # of the way to the wanted torque, per control step: less than 1, as the joints move on meanwhile
_TIP_DEPTH = 0.0105  # m from a tip's centre to where it touches
_FREE_SHARE = 0.15  # of the torque asked for: a finger that lags by less has nothing left to press against
_GIVEN_WAY = (
    0.008  # m that thumb and finger come closer, while they carry, where nothing is between them any more
)
_LOST_STEPS = 11  # control steps that it must last: a push of 0.5 s may unload a finger


class GuardedExecution:
    """Carries out one grasp with feedback from the joint positions."""

    def __init__(
        self, script: ActionScript, normals: Array, forces: Array, tree: RobotTree,
        turn: Callable[[], Turn | None] = lambda: None,
    ) -> None:  # fmt: skip
        """Prepare.

        Args:
            script: approach, close, squeeze, lift, hold; the fingers' part from the close on is replaced by feedback.
            normals: (3, 3) out of the object, thumb, index, middle.
            forces: (3, 3) N on the object, to press with.
            tree: the robot.
            turn: returns how to turn the object in the air, None to hold it as it was lifted. It is asked once, when
                the hand has the object: nobody waits for it.
        """
        self._plan_turn, self._turned = turn, 0.0
        self._turn: Turn | None = None
        self._script, self._tree, self._forces = script, tree, forces
        first = dict(script.phases)
        self._approach_end, self._lift_start, self._hold_start = first["close"], first["lift"], first["hold"]
        self._base = script.targets[self._approach_end - 1] if self._approach_end else script.targets[0]
        self._grasp = script.targets[first["squeeze"] - 1]
        self._travel = self._tip_travel()
        self._normals = normals
        self._progress, self._touched = np.zeros(3), np.zeros(3, bool)
        self._phase, self._count, self._step = "approach", 0, 0
        self._settled = 0
        self._targets = self._base.copy()
        self._pressed = self._base.copy()
        self._before, self._after = self._pressed, self._pressed
        self._spans, self._lost_steps = np.zeros(2), 0

    def _tip_travel(self) -> Array:
        """Way (3,) m of the tips from open to closed, at least 1 mm."""
        open_, closed = self._tips(self._base), self._tips(self._grasp)
        return np.maximum(np.linalg.norm(closed - open_, axis=1), 1e-3)

    def _tips(self, q: Array) -> Array:
        return fingertips(q, self._tree)

    def action(self, joint_positions: Array) -> NDArray[np.float32]:
        """Return the next `joint_position` action for measured joint positions (23,) rad."""
        return normalise(self._next(np.asarray(joint_positions, dtype=float))).astype(np.float32)

    def _next(self, q: Array) -> Array:
        if self._phase == "approach":
            if self._step < self._approach_end:
                self._step += 1
                return self._script.targets[self._step - 1]
            self._phase = "close"
        if self._phase == "close":
            return self._close(q)
        if self._phase == "squeeze":
            return self._squeeze(q)
        return self._carry(q)

    def _close(self, q: Array) -> Array:
        self._count += 1
        lag = -((self._tips(self._targets) - self._tips(q)) * self._normals).sum(1)
        self._touched |= (lag > _TOUCH_LAG) & (self._progress > 0.3)
        limit = 1.0 + _OVERTRAVEL / self._travel
        moving = ~self._touched & (self._progress < limit)
        self._progress[moving] += _CLOSE_SPEED * CONTROL_PERIOD / self._travel[moving]
        self._progress = np.minimum(self._progress, limit)
        for finger, columns in enumerate(_COLUMNS):
            way = self._grasp[columns] - self._base[columns]
            self._targets[columns] = self._base[columns] + self._progress[finger] * way
        # A joint cannot follow beyond its range, and what lags there has touched nothing.
        self._targets = np.clip(self._targets, self._tree.lower, self._tree.upper)
        if not moving.any() or self._count >= _CLOSE_STEPS:
            self._settled += 1
            if self._settled > _SETTLE_STEPS:
                self._count, self._phase = 0, "squeeze"
        return self._targets

    def _wanted(self, q: Array) -> Array:
        """Torques (23,) Nm of the joints that press with the planned forces; 0 for the arm."""
        return self._pressing(q, self._normals, self._forces)

    def _wanted_turned(self, q: Array, share: float) -> Array:
        """Those that press when a share of the turn is done; normals and forces turn with the hand."""
        assert self._turn is not None
        R = palm_frame(q, self._tree)[0] @ palm_frame(self._grasp, self._tree)[0].T
        forces = (1.0 - share) * self._forces + share * self._turn.forces
        return self._pressing(q, self._normals @ R.T, forces @ R.T)

    def _pressing(self, q: Array, normals: Array, forces: Array) -> Array:
        frames = body_frames(q, self._tree)
        points = fingertips(q, self._tree) - _TIP_DEPTH * normals
        J = tip_jacobian(self._tree, frames, points)[:, :, 7:]
        torque = np.einsum("frj,fr->j", J, forces)
        return np.concatenate([np.zeros(7), np.clip(torque, -HAND_TORQUE, HAND_TORQUE)])

    def _squeeze(self, q: Array) -> Array:
        self._count += 1
        lag = min(1.0, self._count / _RAMP_STEPS) * self._wanted(q) / HAND_STIFFNESS
        self._targets = self._targets.copy()
        for columns in _COLUMNS:
            self._targets[columns] += _GAIN * (q + lag - self._targets)[columns]
        self._targets = np.clip(self._targets, self._tree.lower, self._tree.upper)
        if self._count >= _SQUEEZE_STEPS:
            self._pressed, self._spans = self._targets, self._spans_at(q)
            self._phase, self._step, self._turn = "carry", self._lift_start, self._plan_turn()
        return self._targets

    @property
    def lost(self) -> bool:
        """Whether the object has left the hand, as far as the joints can tell."""
        return self._lost_steps >= _LOST_STEPS

    def _carry(self, q: Array) -> Array:
        """Lift and hold: the arm by the script, the fingers pressing as they do; then the turn."""
        self._lost_steps = self._lost_steps + 1 if self._nothing_to_press(q) else 0
        step, self._step = self._step, self._step + 1
        if self._turn is not None and step >= self._hold_start:
            return self._turning(q, self._turn, step - self._hold_start)
        arm = self._script.targets[min(step, len(self._script.targets) - 1)][:7]
        return np.concatenate([arm, self._pressed[7:]])

    def _turning(self, q: Array, turn: Turn, step: int) -> Array:
        """Set-points from the start of the turn on: evenly from what the fingers press with to what they should."""
        if step == 0:
            after = np.concatenate([turn.arm[-1], q[7:]])
            change = self._wanted_turned(after, 1.0) - self._wanted(q)
            self._before, self._after = self._pressed, self._pressed.copy()
            for columns in _COLUMNS:
                self._after[columns] += change[columns] / HAND_STIFFNESS
            self._after = np.clip(self._after, self._tree.lower, self._tree.upper)
        self._turned = min(1.0, (step + 1) / len(turn.arm))
        self._pressed = self._before + self._turned * (self._after - self._before)
        return np.concatenate([turn.arm[min(step, len(turn.arm) - 1)], self._pressed[7:]])

    def _nothing_to_press(self, q: Array) -> bool:
        """Whether a finger no longer lags behind its set-point as it should, or has come closer to the thumb."""
        if (self._spans - self._spans_at(q) > _GIVEN_WAY).any():
            return True
        wanted = self._wanted_turned(q, self._turned) if self._turned else self._wanted(q)
        lag = HAND_STIFFNESS * (self._pressed - q)
        pressing = [(lag[c] @ wanted[c], wanted[c] @ wanted[c]) for c in _COLUMNS]
        free = [given < _FREE_SHARE * asked for given, asked in pressing]
        # Turned, an object that has shifted in the hand leans elsewhere: two fingertips may do.
        return all(free) if self._turned else any(free)

    def _spans_at(self, q: Array) -> Array:
        """Distances (2,) m of index and middle tip from the thumb's."""
        thumb, *fingers = self._tips(q)
        return np.linalg.norm(np.array(fingers) - thumb, axis=1)
