"""Postures of a hand for agent `hardcoded`: those tuned for Allegro, or the pinch of any other."""

from functools import lru_cache

import numpy as np

from dexgrasp.mechanics.kinematics.palm_ik import hanging_palm
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.motion.to_pose import Pinch
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.cell import Cell

# Joints by finger, rad; the ring finger is out of the way.
_RING = {"ring": (0.0, -0.15, 0.0, 0.0)}
_AROUND = {"index": (-0.099, 0.773, 0.936, -0.227), "middle": (0.059, 0.768, 0.969, -0.227)} | _RING
_OPEN = {
    "index": (-0.149, 0.858, 0.0, 0.044), "middle": (0.064, 0.857, 0.0, 0.068), **_RING,
    "thumb": (1.38, 0.35, -0.1, 0.2),
}  # fmt: skip
_HANDS = _OPEN, _AROUND | {"thumb": (1.38, 0.35, 0.45, 0.2)}, _AROUND | {"thumb": (1.38, 0.35, 0.85, 0.2)}
"""Wide around the object; the thumb half way; the thumb's set-point inside any object, so that its servo saturates."""


class TunedPostures:
    """Fixed postures of index, middle and thumb; the palm's place follows from the object's height alone."""

    def __init__(self, cell: Cell) -> None:
        fingers = cell.robot.hand.fingers
        self._hands = [np.concatenate([hand[finger.name] for finger in fingers]) for hand in _HANDS]

    @staticmethod
    def fits(cell: Cell) -> bool:
        """Return True for the hand that the postures were tuned for."""
        fingers = cell.robot.hand.fingers
        return all(len(_OPEN.get(finger.name, ())) == len(finger.joints) for finger in fingers)

    def hands(self, points: Array, axis: Array) -> list[Array]:
        """Return hands (h,) rad: open, closed around the object, and pressing."""
        return self._hands

    def palm(self, points: Array, axis: Array) -> tuple[Array, Array]:
        """Return rotation (3, 3) and position (3,) m of a palm that closes along `axis` (3,), level."""
        R = hanging_palm(axis, 0.2)  # rad, thumb up: the thumb is the longer
        # m from the cloud's mean, along the short axis of the object, from thumb to fingers, and across it.
        p = points.mean(axis=0) + 0.010 * axis - 0.028 * R[:, 1]
        # m above its top, and above the table, which the fingertips must clear
        p[2] = max(points[:, 2].max() + 0.045, 0.137)
        return R, p


class PinchPostures:
    """Pinch of a hand from above, along a level axis."""

    def __init__(self, cell: Cell) -> None:
        self._pinch = Pinch(cell)
        self._lowest = robot_tree(cell).tip_radius + 0.006  # m, tips above the table

    def hands(self, points: Array, axis: Array) -> list[Array]:
        """Return hands (h,) rad: open, with pads at points (N, 3) m along `axis` (3,), and closed."""
        return self._pinch.hands(float(np.ptp(points @ axis)))

    def palm(self, points: Array, axis: Array) -> tuple[Array, Array]:
        """Return rotation (3, 3) and position (3,) m of a palm that looks down and closes along `axis` (3,), level."""
        width, goal = float(np.ptp(points @ axis)), points.mean(axis=0)
        # m between the palm and the object's top
        goal[2] = max(goal[2], points[:, 2].max() - self._pinch.reach(width) + 0.015, self._lowest)
        return self._pinch.palm(goal, np.array([0.0, 0.0, -1.0]), axis, width)


@lru_cache(maxsize=4)
def hand_postures(cell: Cell) -> TunedPostures | PinchPostures:
    """Return the postures of a cell's hand, found once."""
    return TunedPostures(cell) if TunedPostures.fits(cell) else PinchPostures(cell)
