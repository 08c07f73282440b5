"""The simulated cell and its robot, as tests name them."""

from dexgrasp_env.robot.cell import default_cell

CELL = default_cell()
ROBOT = CELL.robot
HOME, LOWER, UPPER, VELOCITY, TORQUE = ROBOT.home, ROBOT.lower, ROBOT.upper, ROBOT.velocity, ROBOT.torque
JOINTS, BODIES = ROBOT.joints, ROBOT.bodies
ARM_JOINTS, HAND_JOINTS = ROBOT.arm.joints.names, ROBOT.hand.joints.names
ARM_BODIES, HAND_BODIES = ROBOT.arm.bodies, ROBOT.hand.bodies
FINGERS = tuple(finger.name for finger in ROBOT.hand.fingers)
GRASP_FINGERS = ROBOT.hand.grasp
TIPS = ROBOT.tips
MOUNTS = CELL.mounts
