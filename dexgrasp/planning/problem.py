"""What every step of planning is told."""

from typing import NamedTuple

from dexgrasp.kinematics.tree import RobotTree
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.shape.target import GraspTarget


class Problem(NamedTuple):
    """What is to be grasped, by which robot, within which limits."""

    target: GraspTarget
    tree: RobotTree
    settings: PlannerSettings
