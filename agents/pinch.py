"""Pinch of any hand, for agent `hardcoded`: its tips close along the short axis, from open to where its pads meet."""

from functools import lru_cache

import numpy as np

from dexgrasp.mechanics.kinematics.forward import fingertips
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.robot_check import closed_posture
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.cell import Cell

_STAGES = 50  # postures looked at between open and closed
_OFF = 0.004  # m that pads keep from the object before they press
_ROOM = 0.015  # m between the palm and the object's top
_LOW = 0.006  # m between the tips and the table


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
        whole = [cell.robot.freed(q) for q in np.linspace(opened, closed, _STAGES)]
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
        goal[2] = max(goal[2], points[:, 2].max() - reach + _ROOM, self._tree.tip_radius + _LOW)
        return R, goal - R @ middle

    def _stage(self, points: Array, axis: Array) -> int:
        """Return the last stage in which the pads are off points (N, 3) m along an axis (3,)."""
        wide = float(np.ptp(points @ axis)) + 2.0 * _OFF
        return int(max(np.flatnonzero(self._gaps >= wide), default=0))


def _basis(x: Array, y: Array) -> Array:
    """Return axes (3, 3) as columns: x, y less its part along x, and across both."""
    y = y - x * (x @ y)
    y = y / np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


@lru_cache(maxsize=4)
def pinch_of(cell: Cell) -> Pinch:
    """Return the pinch of a cell's hand, found once."""
    return Pinch(cell)
