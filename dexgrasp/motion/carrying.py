"""Lift and hold of what the hand has, and a turn of it in the air; it feels through the joints when it is lost.

From the lift on the set-points of the fingers stand still, but for the turn, in which they go over to forces that hold
the object as it then is.
"""

import numpy as np

from dexgrasp.kinematics.palm_ik import palm_frame
from dexgrasp.motion.guarded import COLUMNS, GuardedGrasp, pressing_torques, tip_spans
from dexgrasp.motion.motion import Motion
from dexgrasp.motion.turn import Turn
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.limits import HAND_STIFFNESS

_FREE_SHARE = 0.15  # of the torque asked for: a finger that lags by less has nothing left to press against
_GIVEN_WAY = 0.008  # m that thumb and finger come closer where nothing is between them any more
_LOST_STEPS = 11  # control steps that it must last: a push of 0.5 s may unload a finger


class GuardedCarry(Motion):
    """Carries what was taken hold of: the arm by the script, the fingers pressing as they do."""

    def __init__(self, held: GuardedGrasp, turn: Turn | None = None) -> None:
        """Prepare.

        Args:
            held: that is done.
            turn: of the object in the air, None to hold it as it was lifted.
        """
        self._held, self._turn, self._tree = held, turn, held.tree
        first = dict(held.script.phases)
        self._step, self._hold_start = first["lift"], first["hold"]
        self._closed = held.script.targets[first["squeeze"] - 1]
        self._pressed = self._before = self._after = held.targets
        self._turned, self._lost_steps = 0.0, 0

    @property
    def lost(self) -> bool:
        """Whether the object has left the hand, as far as the joints can tell."""
        return self._lost_steps >= _LOST_STEPS

    def _next(self, q: Array) -> Array:
        self._lost_steps = self._lost_steps + 1 if self._nothing_to_press(q) else 0
        step, self._step = self._step, self._step + 1
        if self._turn is not None and step >= self._hold_start:
            return self._turning(q, self._turn, step - self._hold_start)
        targets = self._held.script.targets
        return np.concatenate([targets[min(step, len(targets) - 1)][:7], self._pressed[7:]])

    def _turning(self, q: Array, turn: Turn, step: int) -> Array:
        """Set-points from the start of the turn on: evenly from what the fingers press with to what they should."""
        if step == 0:
            after = np.concatenate([turn.arm[-1], q[7:]])
            change = self._wanted(after, 1.0) - self._wanted(q, 0.0)
            self._before, self._after = self._pressed, self._pressed.copy()
            for columns in COLUMNS:
                self._after[columns] += change[columns] / HAND_STIFFNESS
            self._after = np.clip(self._after, self._tree.lower, self._tree.upper)
        self._turned = min(1.0, (step + 1) / len(turn.arm))
        self._pressed = self._before + self._turned * (self._after - self._before)
        return np.concatenate([turn.arm[min(step, len(turn.arm) - 1)], self._pressed[7:]])

    def _wanted(self, q: Array, share: float) -> Array:
        """Torques (23,) Nm that press when a share of the turn is done; normals and forces turn with the hand."""
        grasp = self._held.grasp
        if self._turn is None or share == 0.0:
            return pressing_torques(q, grasp.normals, grasp.forces, self._tree)
        R = palm_frame(q, self._tree)[0] @ palm_frame(self._closed, self._tree)[0].T
        forces = (1.0 - share) * grasp.forces + share * self._turn.forces
        return pressing_torques(q, grasp.normals @ R.T, forces @ R.T, self._tree)

    def _nothing_to_press(self, q: Array) -> bool:
        """Whether a finger no longer lags behind its set-point as it should, or has come closer to the thumb."""
        if (self._held.spans - tip_spans(q, self._tree) > _GIVEN_WAY).any():
            return True
        wanted = self._wanted(q, self._turned)
        lag = HAND_STIFFNESS * (self._pressed - q)
        pressing = [(lag[c] @ wanted[c], wanted[c] @ wanted[c]) for c in COLUMNS]
        free = [given < _FREE_SHARE * asked for given, asked in pressing]
        # Turned, an object that has shifted in the hand leans elsewhere: two fingertips may do.
        return all(free) if self._turned else any(free)
