"""Names of the robot's parts of the process's cell."""

from dexgrasp_env.robot.active import active_cell

_ROBOT = active_cell().robot
ARM_JOINTS = _ROBOT.arm.joints.names
FINGERS = tuple(finger.name for finger in _ROBOT.hand.fingers)
GRASP_FINGERS = _ROBOT.hand.grasp
FINGER_COLUMNS = _ROBOT.columns
HAND_JOINTS = _ROBOT.hand.joints.names
JOINTS = _ROBOT.joints
ARM_BODIES = _ROBOT.arm.bodies
HAND_BODIES = _ROBOT.hand.bodies
BODIES = _ROBOT.bodies
MOUNT_NAMES = active_cell().mounts
PALM_SITE = _ROBOT.hand.palm
TIP_SITES = TIP_GEOMS = _ROBOT.tips
