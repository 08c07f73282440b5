"""Lift and hold of what the hand has, and a turn of it in the air; it feels through the joints when it is lost.

From the lift on the set-points of the fingers stand still, but for the turn, in which they go over to forces that hold
the object as it then is.
"""

import numpy as np

from dexgrasp.grasp.grasp import Grasp
from dexgrasp.grasp.trajectory import ActionScript
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.motion.carried import Turn
from dexgrasp.motion.motion import Motion, arm_and_hand
from dexgrasp.motion.move_until_contact import (
    GuardedGrasp,
    finger_of_joints,
    lag_of,
    pressing_torques,
    tip_spans,
    within_range,
)
from dexgrasp_env.arrays import Array


class GuardedCarry(Motion):
    """Carries what was taken hold of: the arm by the script, the fingers pressing as they do."""

    def __init__(self, held: GuardedGrasp, turn: Turn | None = None) -> None:
        """Prepare.

        Args:
            held: that is done.
            turn: of the object in the air, None to hold it as it was lifted.
        """
        self._held, self._turn, self.tree = held, turn, held.tree
        phases = held.script.phases
        self._hold_start = len(held.script.targets) - len(phases["hold"])
        self._step, self._closed = self._hold_start - len(phases["lift"]), phases["close"][-1]
        self._pressed = self._before = self._after = held.targets
        self._turned, self._lost_steps = 0.0, 0

    @property
    def lost(self) -> bool:
        """True once the object has left the hand, as far as the joints can tell."""
        # Control steps that it must last: later on a push of 0.5 s may unload a finger.
        return self._lost_steps >= (6 if self.lifting else 11)

    @property
    def lifting(self) -> bool:
        """True while the hand is on its way up."""
        return self._step <= self._hold_start

    @property
    def overdue(self) -> bool:
        """True once an episode in which the object was held would have ended."""
        return self._step >= len(self._held.script.targets) + 10  # control steps past the end of the hold

    def _next(self, q: Array) -> Array:
        self._lost_steps = self._lost_steps + 1 if self._nothing_to_press(q) else 0
        step, self._step = self._step, self._step + 1
        if self._turn is not None and step >= self._hold_start:
            return self._turning(q, self._turn, step - self._hold_start)
        return arm_and_hand(self._held.script.at(step), self._pressed, self.tree)

    def _turning(self, q: Array, turn: Turn, step: int) -> Array:
        """Set-points from the start of the turn on: evenly from what the fingers press with to what they should."""
        if step == 0:
            turned = arm_and_hand(turn.arm[-1], q, self.tree)
            change = self._wanted(turned, 1.0) - self._wanted(q, 0.0)
            self._before = self._pressed
            self._after = within_range(self._pressed + lag_of(change, self.tree), self.tree)
        self._turned = min(1.0, (step + 1) / len(turn.arm))
        self._pressed = self._before + self._turned * (self._after - self._before)
        return arm_and_hand(turn.arm[min(step, len(turn.arm) - 1)], self._pressed, self.tree)

    def _wanted(self, q: Array, share: float) -> Array:
        """Torques (n,) Nm that press when a share of the turn is done; normals and forces turn with the hand."""
        grasp = self._held.grasp
        if self._turn is None or share == 0.0:
            return pressing_torques(q, grasp.normals, grasp.forces, self.tree)
        R = palm_frame(q, self.tree)[0] @ palm_frame(self._closed, self.tree)[0].T
        forces = (1.0 - share) * grasp.forces + share * self._turn.forces
        forces[:, :3] = forces[:, :3] @ R.T
        return pressing_torques(q, grasp.normals @ R.T, forces, self.tree)

    def _nothing_to_press(self, q: Array) -> bool:
        """Return True where fingers no longer lag as they should behind set-points, or have come closer to the thumb.

        On the way up one of them tells. What hangs may have shifted and hang from two: it is lost when all are free.
        """
        enough = np.any if self.lifting else np.all
        # m that thumb and finger come closer where nothing is between them any more
        if enough(self._held.spans - tip_spans(q, self.tree) > 0.008):
            return True
        hand = slice(self.tree.arm, None)
        given, asked = (self._pressed - q)[hand] * self.tree.stiffness, self._wanted(q, self._turned)[hand]
        of_finger = finger_of_joints(self.tree)[hand] == np.arange(len(self.tree.fingers))[:, None]
        # of the torque asked for: a finger that lags by less has nothing left to press against
        return bool(enough(of_finger @ (given * asked) < 0.15 * (of_finger @ (asked * asked))))


class PickUp(Motion):
    """Takes hold of an object and carries it, one after the other."""

    def __init__(self, script: ActionScript, grasp: Grasp) -> None:
        """Take what `GuardedGrasp` takes."""
        self._motion: GuardedGrasp | GuardedCarry = GuardedGrasp(script, grasp)
        self.tree = self._motion.tree

    def _next(self, q: Array) -> Array:
        if isinstance(self._motion, GuardedGrasp) and self._motion.done:
            self._motion = GuardedCarry(self._motion)
        return self._motion._next(q)
