"""Back from a grasp that was lost: open the hand, take the arm home, where the cameras see past it."""

import numpy as np

from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.motion.approach import plan_approach
from dexgrasp.motion.collision import CollisionChecker
from dexgrasp.motion.motion import Played, arm_and_hand
from dexgrasp.motion.timing import still, time_path
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.cell import Cell


def plan_retreat(start: Array, cell: Cell, neighbours: ConvexDistance | None) -> Played:
    """Return the way home; where the object lies now nobody knows, so only its neighbours are kept clear of.

    Args:
        start: (n,) rad, the set-points now.
        cell: of the robot.
        neighbours: of the object; None where there is nothing.

    Raises:
        NoPath: where that, the table or the robot itself is in the way.
    """
    checker, home, tree = CollisionChecker(cell, neighbours), cell.robot.home, robot_tree(cell)
    start = np.clip(start, tree.lower, tree.upper)
    opened = arm_and_hand(start, home, tree)
    speed = 0.9  # of the limits: the hand is empty, and an episode has time for a second grasp only
    # Unchecked: pressing fingers are set inside one another.
    opening = time_path(np.stack([start, opened]), tree, speed=speed)
    way = time_path(plan_approach(checker, opened, home), tree, checker, speed)
    rows = np.concatenate([opening, way, still(home, 0.35)])  # s at home: the arm's servos lag by 0.1 s
    return Played(np.clip(rows, tree.lower, tree.upper), tree)
