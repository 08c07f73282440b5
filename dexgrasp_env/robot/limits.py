"""Limits and reference postures of the robot, in the order of `names.JOINTS`: those of the cell (`cell.active_cell`).

Sources of the simulated cell: the maker's tables of the Franka Emika Panda (FER) and of the Allegro Hand V4.
"""

from dexgrasp_env.robot.cell import active_cell
from dexgrasp_env.robot.home import HOME, HOME_ARM, OPEN_HAND, table

__all__ = [
    "ACCELERATION", "ARM_ACCELERATION", "ARM_JERK", "ARM_LOWER", "ARM_TORQUE", "ARM_UPPER", "ARM_VELOCITY",
    "FLANGE_ACCELERATION", "FLANGE_SPEED", "FLANGE_TURN_ACCELERATION", "FLANGE_TURN_SPEED", "HAND_ACCELERATION",
    "HAND_JERK", "HAND_LOWER", "HAND_STIFFNESS", "HAND_TORQUE", "HAND_UPPER", "HAND_VELOCITY", "HOME", "HOME_ARM",
    "LOWER", "OPEN_HAND", "PAYLOAD", "REACH", "TORQUE", "UPPER", "VELOCITY",
]  # fmt: skip

_ARM, _HAND = active_cell().arm, active_cell().hand

ARM_LOWER = table(*_ARM.lower)
"""Least arm positions, (7,) rad."""
ARM_UPPER = table(*_ARM.upper)
"""Greatest arm positions, (7,) rad."""
HAND_LOWER = table(*_HAND.lower)
"""Least hand positions, (16,) rad."""
HAND_UPPER = table(*_HAND.upper)
"""Greatest hand positions, (16,) rad."""
LOWER = table(*ARM_LOWER, *HAND_LOWER)
"""Least positions, (23,) rad."""
UPPER = table(*ARM_UPPER, *HAND_UPPER)
"""Greatest positions, (23,) rad."""

ARM_VELOCITY = table(*_ARM.velocity)
"""Arm velocity limits, (7,) rad/s."""
ARM_ACCELERATION = table(*_ARM.acceleration)
"""Arm acceleration limits, (7,) rad/s^2."""
ARM_JERK = table(*_ARM.jerk)
"""Arm jerk limits, (7,) rad/s^3."""
ARM_TORQUE = table(*_ARM.torque)
"""Arm torque limits, (7,) Nm."""

# The hand's maker states no joint speed, acceleration or jerk: the simulated cell's are decisions of ours.
HAND_VELOCITY = table(*_HAND.velocity)
"""Hand velocity limits, (16,) rad/s."""
HAND_ACCELERATION = table(*_HAND.acceleration)
"""Hand acceleration limits, (16,) rad/s^2."""
HAND_JERK = table(*_HAND.jerk)
"""Hand jerk limits, (16,) rad/s^3."""
HAND_TORQUE = table(*_HAND.torque)
"""Hand torque limits, (16,) Nm."""
HAND_STIFFNESS = _HAND.stiffness[0]
"""kp of the hand's position servos, Nm/rad."""

VELOCITY = table(*ARM_VELOCITY, *HAND_VELOCITY)
"""Velocity limits, (23,) rad/s."""
ACCELERATION = table(*ARM_ACCELERATION, *HAND_ACCELERATION)
"""Acceleration limits, (23,) rad/s^2."""
TORQUE = table(*ARM_TORQUE, *HAND_TORQUE)
"""Torque limits, (23,) Nm."""

FLANGE_SPEED = 1.7
"""Cartesian limit, m/s."""
FLANGE_ACCELERATION = 13.0
"""Cartesian limit, m/s^2."""
FLANGE_TURN_SPEED = 2.5
"""Cartesian limit, rad/s."""
FLANGE_TURN_ACCELERATION = 25.0
"""Cartesian limit, rad/s^2."""
PAYLOAD = 3.0
"""What the arm may carry beyond the flange, hand included, kg."""
REACH = 0.855
"""The arm's reach, m."""
