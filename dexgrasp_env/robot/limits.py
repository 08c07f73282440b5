"""Limits of the robot of the process's cell."""

from dexgrasp_env.robot.active import active_cell
from dexgrasp_env.robot.home import HOME, HOME_ARM, OPEN_HAND

__all__ = ["HOME", "HOME_ARM", "OPEN_HAND"]
_R = active_cell().robot
_N = _R.arm_dof
LOWER, UPPER, VELOCITY, ACCELERATION, TORQUE = _R.lower, _R.upper, _R.velocity, _R.acceleration, _R.torque
ARM_LOWER, ARM_UPPER, HAND_LOWER, HAND_UPPER = LOWER[:_N], UPPER[:_N], LOWER[_N:], UPPER[_N:]
ARM_VELOCITY, ARM_ACCELERATION, ARM_JERK = VELOCITY[:_N], ACCELERATION[:_N], _R.jerk[:_N]
HAND_VELOCITY, HAND_ACCELERATION, HAND_JERK = VELOCITY[_N:], ACCELERATION[_N:], _R.jerk[_N:]
ARM_TORQUE, HAND_TORQUE = TORQUE[:_N], TORQUE[_N:]
HAND_STIFFNESS = _R.hand.joints.stiffness[0]
