"""Agents to learn from."""

import numpy as np

from dexgrasp.agent import BY_CLOUD
from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.agents.hardcoded import HardcodedAgent
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp_env.arrays import Array

_TURNS = np.deg2rad(np.arange(0.0, 180.0, 3.0))
_WIDER = 1.03, 0.003  # factor and m by which a grip may be wider than the narrowest


class Teacher(HardcodedAgent):
    """Like `hardcoded`, but its choices are easy to learn: it turns the wrist as little as the object's width allows.

    `hardcoded` grips along the short principal axis. Of something nearly round that axis is made by the noise of the
    cameras, and nobody can learn it. Here every grip about as narrow as the narrowest will do, and the one that needs
    the least turn of the wrist is taken.
    """

    def _arms(self, start: Array, points: Array) -> list[Array]:
        """Return those of grips along the narrowest directions, least turn of the wrist first."""
        widths = np.ptp(points[:, :2] @ np.stack([np.cos(_TURNS), np.sin(_TURNS)]), axis=0)
        narrow = _TURNS[widths <= widths.min() * _WIDER[0] + _WIDER[1]]
        R, _ = palm_frame(start, robot_tree(self._cell))
        middle = points.mean(axis=0)
        straight = np.arctan2(R[1, 2], R[0, 2]) - start[0] + np.arctan2(middle[1], middle[0])
        turns = np.concatenate([narrow, narrow + np.pi]) - straight
        turns = (turns + np.pi) % (2 * np.pi) - np.pi
        best = turns[np.argmin(np.abs(turns))]
        other = best - np.sign(best) * np.pi if best else np.pi
        axes = [np.array([np.cos(a), np.sin(a), 0.0]) for a in straight + np.array([best, other])]
        return self._reached(start, points, axes)


class PlansOnce(BilevelAgent):
    """`bilevel` that looks and plans once: an episode of two grasps teaches no single closing."""

    env_settings = BY_CLOUD

    def __init__(self) -> None:
        """Prepare the planner."""
        super().__init__(regrasps=0)
