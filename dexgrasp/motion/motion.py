"""Motions, carried out a control step at a time, and the reason why a grasp cannot be carried out."""

from abc import ABC, abstractmethod

import numpy as np

from dexgrasp.mechanics.kinematics.forward import follow
from dexgrasp.mechanics.kinematics.tree import RobotTree
from dexgrasp_env.arrays import Array, Single
from dexgrasp_env.tasks.control import normalise


class Motion(ABC):
    """Set-points one after the other, from what the joints feel.

    Attributes:
        tree: of the robot that moves.
    """

    tree: RobotTree

    def action(self, joint_positions: Array) -> Single:
        """Return the next `joint_position` action for measured joint positions (n,) rad."""
        q = np.array(joint_positions, dtype=float)
        if self.tree.stands.any():
            follow(q, self.tree)  # what the servos feel of a tendon is its length
        return normalise(self._next(q), self.tree).astype(np.float32)

    @abstractmethod
    def _next(self, q: Array) -> Array:
        """Return the next set-points (n,) rad."""


class Played(Motion):
    """Set-points that are known beforehand, one a control step; the last are held."""

    def __init__(self, rows: Array, tree: RobotTree) -> None:
        """Take set-points (T, n) rad, and the robot."""
        self.tree, self._rows, self._step = tree, rows, 0

    @property
    def done(self) -> bool:
        """True once all have been played."""
        return self._step >= len(self._rows)

    def _next(self, q: Array) -> Array:
        self._step += 1
        return self._rows[min(self._step, len(self._rows)) - 1]


def arm_and_hand(arm: Array, hand: Array, tree: RobotTree) -> Array:
    """Return the configuration (n,) rad with the arm as in one, which may lack the hand, and the hand as in another."""
    return np.concatenate([arm[: tree.arm], hand[tree.arm :]])


class NoPath(Exception):  # noqa: N818  (it is an outcome, not a defect)
    """A grasp that cannot be carried out.

    Attributes:
        reason: in a word that can be counted, e.g. `approach_blocked`.
        detail: which bodies are in the way and by how much.
    """

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason, self.detail = reason, detail
