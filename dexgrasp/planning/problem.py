"""What every step of planning is told."""

from typing import NamedTuple

from dexgrasp.geometry.convex_kernel import NOTHING, Obstacle
from dexgrasp.kinematics.tree import RobotTree, robot_tree
from dexgrasp.physics.contacts import Shape, shape_of
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

    @property
    def shape(self) -> Shape:
        """Of the contacts that the grasping fingers make."""
        return shape_of(len(self.tree.tip_body), self.tree.torsion)

    @property
    def obstacles(self) -> tuple[Obstacle, Obstacle]:
        """The object, which the tips may touch, and what stands around it, which nothing may."""
        around = self.target.around
        return self.target.distance.obstacle, NOTHING if around is None else around.obstacle
