"""Postures of a hand for agent `hardcoded`: those tuned for Allegro, or the pinch of any other."""

from functools import lru_cache

import numpy as np

from dexgrasp.mechanics.kinematics.forward import fingertips
from dexgrasp.mechanics.kinematics.palm_ik import hanging_palm, palm_frame
from dexgrasp.mechanics.kinematics.robot_check import closed_posture
from dexgrasp.mechanics.kinematics.tree import robot_tree
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


class Tuned:
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


class Pinch:
    """Postures of a hand whose first finger closes against the others, and where its palm then is.

    Attributes:
        stages: (k, h) rad, from open to closed.
        tips: (k, g, 3) m, centres of the grasping tips in the palm frame.
    """

    def __init__(self, cell: Cell) -> None:
        """Close the hand from its open posture."""
        self._tree = robot_tree(cell)
        opened, closed = cell.robot.home, closed_posture(cell)[0]
        whole = [cell.robot.freed(q) for q in np.linspace(opened, closed, 50)]
        R, p = palm_frame(opened, self._tree)
        self.tips = np.stack([(fingertips(q, self._tree) - p) @ R for q in whole])
        self.stages = np.stack([q[self._tree.arm :] for q in whole])
        between = self.tips[:, 1:].mean(1) - self.tips[:, 0]
        self._gaps = np.linalg.norm(between, axis=1) - 2.0 * self._tree.tip_radius

    def hands(self, points: Array, axis: Array) -> list[Array]:
        """Return hands (h,) rad: open, with pads at points (N, 3) m along `axis` (3,), and closed."""
        return [self.stages[0], self.stages[self._stage(points, axis)], self.stages[-1]]

    def palm(self, points: Array, axis: Array) -> tuple[Array, Array]:
        """Return rotation (3, 3) and position (3,) m of a palm that looks down and closes along `axis` (3,), level."""
        tips = self.tips[self._stage(points, axis)]
        middle = 0.5 * (tips[0] + tips[1:].mean(0))
        across = (tips[1:].mean(0) - tips[0]) * [0.0, 1.0, 1.0]
        R = _basis(np.array([0.0, 0.0, -1.0]), axis) @ _basis(np.array([1.0, 0.0, 0.0]), across).T
        goal = points.mean(axis=0)
        reach = float(middle[0])  # of the tips in front of the palm
        # m between the palm and the object's top, and between the tips and the table
        goal[2] = max(goal[2], points[:, 2].max() - reach + 0.015, self._tree.tip_radius + 0.006)
        return R, goal - R @ middle

    def _stage(self, points: Array, axis: Array) -> int:
        """Return the last stage in which the pads are off points (N, 3) m along an axis (3,)."""
        wide = float(np.ptp(points @ axis)) + 2.0 * 0.004  # m that pads keep off before they press
        return int(max(np.flatnonzero(self._gaps >= wide), default=0))


def _basis(x: Array, y: Array) -> Array:
    """Return axes (3, 3) as columns: x, y less its part along x, and across both."""
    y = y - x * (x @ y)
    y = y / np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


@lru_cache(maxsize=4)
def hand_postures(cell: Cell) -> Tuned | Pinch:
    """Return the postures of a cell's hand, found once."""
    return Tuned(cell) if Tuned.fits(cell) else Pinch(cell)
