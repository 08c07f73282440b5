"""Limits and reference postures of the robot, in the order of `names.JOINTS`.

Sources: the maker's tables of the Franka Emika Panda (FER) and of the Allegro Hand V4.
"""

import numpy as np

from dexgrasp_env.arrays import Array


def _table(*values: float) -> Array:
    """A read-only array: the tables are shared by everybody."""
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array


_FINGER_LOWER = (-0.47, -0.196, -0.174, -0.227)
_FINGER_UPPER = (0.47, 1.61, 1.709, 1.618)

ARM_LOWER = _table(-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973)
"""Least arm positions, (7,) rad."""
ARM_UPPER = _table(2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973)
"""Greatest arm positions, (7,) rad."""
HAND_LOWER = _table(*_FINGER_LOWER * 3, 0.263, -0.105, -0.189, -0.162)
"""Least hand positions, (16,) rad."""
HAND_UPPER = _table(*_FINGER_UPPER * 3, 1.396, 1.163, 1.644, 1.719)
"""Greatest hand positions, (16,) rad."""
LOWER = _table(*ARM_LOWER, *HAND_LOWER)
"""Least positions, (23,) rad."""
UPPER = _table(*ARM_UPPER, *HAND_UPPER)
"""Greatest positions, (23,) rad."""

ARM_VELOCITY = _table(2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61)
"""Arm velocity limits, (7,) rad/s."""
ARM_ACCELERATION = _table(15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
"""Arm acceleration limits, (7,) rad/s^2."""
ARM_JERK = _table(7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0)
"""Arm jerk limits, (7,) rad/s^3."""
ARM_TORQUE = _table(87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0)
"""Arm torque limits, (7,) Nm."""

# The hand's maker states no joint speed. 7 rad/s is our decision: about what small geared servos reach.
HAND_VELOCITY = _table(*(7.0,) * 16)
"""Hand velocity limits, (16,) rad/s; a decision of ours."""
# Nor an acceleration or a jerk: these are ours as well, gentle for what they drive.
HAND_ACCELERATION = _table(*(60.0,) * 16)
"""Hand acceleration limits, (16,) rad/s^2; a decision of ours."""
HAND_JERK = _table(*(3000.0,) * 16)
"""Hand jerk limits, (16,) rad/s^3; a decision of ours."""
HAND_TORQUE = _table(*(0.7,) * 16)
"""Hand torque limits, (16,) Nm."""
HAND_STIFFNESS = 10.0
"""kp of the hand's position servos, Nm/rad."""

VELOCITY = _table(*ARM_VELOCITY, *HAND_VELOCITY)
"""Velocity limits, (23,) rad/s."""
ACCELERATION = _table(*ARM_ACCELERATION, *HAND_ACCELERATION)
"""Acceleration limits, (23,) rad/s^2."""
TORQUE = _table(*ARM_TORQUE, *HAND_TORQUE)
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

HOME_ARM = _table(0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4)
"""The arm's ready configuration, (7,) rad."""
OPEN_HAND = _table(*(0.0, 0.8, 0.4, 0.3) * 3, 1.35, 0.4, 0.2, 0.25)
"""An open hand with the thumb opposite the fingers, (16,) rad: the pre-shape of a grasp."""
HOME = _table(*HOME_ARM, *OPEN_HAND)
"""Home arm and open hand, (23,) rad."""
