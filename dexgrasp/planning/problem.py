"""What every step of planning is told."""

from typing import NamedTuple

from dexgrasp.kinematics.tree import RobotTree, robot_tree
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.shape.target import GraspTarget
from dexgrasp_env.robot.cell import Cell


class Problem(NamedTuple):
    """What is to be grasped, by which robot, within which limits."""

    target: GraspTarget
    cell: Cell
    settings: PlannerSettings

    @property
    def tree(self) -> RobotTree:
        """Kinematics of the robot."""
        return robot_tree(self.cell)
