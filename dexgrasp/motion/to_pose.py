"""Motion to a hand pose that somebody else chose: a network's grasp, a sampler's, one by hand."""

from collections.abc import Sequence

import numpy as np

from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.geometry.hull import standing_hull
from dexgrasp.grasp.grasp import GraspMotion
from dexgrasp.grasp.trajectory import ActionScript
from dexgrasp.mechanics.kinematics.forward import fingertips
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame, solve_palm
from dexgrasp.mechanics.kinematics.robot_check import closed_posture
from dexgrasp.mechanics.kinematics.tree import RobotTree, robot_tree
from dexgrasp.motion.motion import NoPath
from dexgrasp.motion.script import make_script
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.valid import checked


@checked
def plan_to_pose(
    palm: tuple[Array, Array], hands: Sequence[Array], points: Array, start: Array, cell: Cell
) -> ActionScript:
    """Return the set-points that bring the palm to a pose, close the hand, lift and hold.

    Args:
        palm: rotation (3, 3) and position (3,) m of the palm frame in the world frame: x out of the palm's face, z
            towards the fingers, y towards the first finger that is not the thumb.
        hands: hands (h,) rad, open, touching and pressing; a `Pinch` has those of a width.
        points: (N, 3) m of the object, whose convex hull down to the table the way there keeps clear of.
        start: (n,) rad, where the robot stands.
        cell: robot and table.

    Raises:
        NoPath: where the arm does not reach the pose, or something is in the way, which the reason says.
        InputError: for points without a volume.
    """
    arm = arm_at(palm, start, robot_tree(cell))
    if arm is None:
        raise NoPath("out_of_reach", "the arm does not reach the palm's pose")
    return plan_with_arm(arm, hands, standing_hull(points), start, cell)


def plan_with_arm(
    arm: Array, hands: Sequence[Array], obstacle: ConvexDistance, start: Array, cell: Cell
) -> ActionScript:
    """Return `plan_to_pose`'s set-points for an arm (a,) rad that is at the pose, and the object's hull.

    Raises:
        NoPath: where something is in the way, which the reason says.
    """
    motion = GraspMotion(*(np.concatenate([arm, hand]) for hand in hands))
    return make_script(start, motion, obstacle, cell, margin=0.002)


def arm_at(palm: tuple[Array, Array], start: Array, tree: RobotTree) -> Array | None:
    """Return the arm's configuration (a,) rad for a palm pose, searched from `start` (n,) turned there; None: none."""
    R, p = palm
    q = start.copy()
    q[0] = np.arctan2(p[1], p[0])
    return q[: tree.arm].copy() if solve_palm(q, R, p, tree, 300, 1e-5) < 0.003 else None  # m


class Pinch:
    """Postures of a hand whose first finger closes against the others, as the two pads of a gripper."""

    @checked
    def __init__(self, cell: Cell) -> None:
        """Close the hand from its open posture."""
        tree = robot_tree(cell)
        opened, closed = cell.robot.home, closed_posture(cell)[0]
        whole = [cell.robot.freed(q) for q in np.linspace(opened, closed, 50)]
        R, p = palm_frame(opened, tree)
        self._tips = np.stack([(fingertips(q, tree) - p) @ R for q in whole])
        self._stages = np.stack([q[tree.arm :] for q in whole])
        between = self._tips[:, 1:].mean(1) - self._tips[:, 0]
        self._gaps = np.linalg.norm(between, axis=1) - 2.0 * tree.tip_radius

    @property
    def widest(self) -> float:
        """m, the widest object that fits between the pads, with 1 mm on either side."""
        return float(self._gaps.max()) - 0.002

    def hands(self, width: float) -> list[Array]:
        """Return hands (h,) rad: open, with pads beside an object of a width m, and closed."""
        return [self._stages[0], self._stages[self._stage(width)], self._stages[-1]]

    def reach(self, width: float) -> float:
        """Return how far in front of the palm the pads meet an object of a width, m."""
        return float(self._middle(width)[0])

    def palm(self, center: Array, approach: Array, axis: Array, width: float) -> tuple[Array, Array]:
        """Return rotation (3, 3) and position (3,) m of the palm of a grasp of two pads.

        Args:
            center: (3,) m, the middle between the pads.
            approach: (3,) unit, from the palm to the center.
            axis: (3,) unit, from the first finger's pad to the other; its part along `approach` is left out.
            width: m, of the object between the pads.
        """
        tips = self._tips[self._stage(width)]
        across = (tips[1:].mean(0) - tips[0]) * [0.0, 1.0, 1.0]
        R = _basis(approach, axis) @ _basis(np.array([1.0, 0.0, 0.0]), across).T
        return R, center - R @ self._middle(width)

    def _middle(self, width: float) -> Array:
        tips = self._tips[self._stage(width)]
        middle: Array = 0.5 * (tips[0] + tips[1:].mean(0))
        return middle

    def _stage(self, width: float) -> int:
        """Return the last stage in which the pads are 4 mm off an object of a width."""
        return int(max(np.flatnonzero(self._gaps >= width + 2.0 * 0.004), default=0))


def _basis(x: Array, y: Array) -> Array:
    """Return axes (3, 3) as columns: x, y less its part along x, and across both."""
    y = y - x * (x @ y)
    y = y / np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)
