"""The simulated cell and its robot, as tests name them."""

from typing import Any

from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.cell import default_cell

CELL = default_cell()
ROBOT = CELL.robot
HOME, LOWER, UPPER, VELOCITY, TORQUE = ROBOT.home, ROBOT.lower, ROBOT.upper, ROBOT.velocity, ROBOT.torque
JOINTS, BODIES = ROBOT.joints, ROBOT.bodies
ARM_JOINTS, HAND_JOINTS = ROBOT.arm.joints.names, ROBOT.hand.joints.names
ARM_BODIES = ROBOT.arm.bodies
FINGERS = tuple(finger.name for finger in ROBOT.hand.fingers)
GRASP_FINGERS = ROBOT.hand.grasp
TIPS = ROBOT.tips
MOUNTS = CELL.mounts


def denormalise(action: Array, robot: Any) -> Array:
    """`joint_position` actions (..., n) as joint positions (..., n) rad."""
    return robot.lower + 0.5 * (action + 1.0) * (robot.upper - robot.lower)
