"""Constants of the task, frozen as Lift-v0."""

import math

LIFT_HEIGHT = 0.10  # m, lowest point of the object above the table
HOLD_STEPS = 60  # control steps at 20 Hz: 3 s
MAX_EPISODE_STEPS = 300  # control steps: 15 s

STABLE_SLIP = 0.025  # m of motion in the hand's frame during lift and hold
STABLE_TILT = math.radians(15.0)
OFF_TABLE = 0.002  # m: from here on the object counts as lifted off

# Where an object may be before it counts as lost: centre, robot base frame, m.
WORKSPACE_LOW = (0.05, -0.65, -0.05)
WORKSPACE_HIGH = (1.05, 0.65, 1.30)

PLACE_X = (0.42, 0.60)  # m; the arm reaches every yaw here (92 % at 0.70)
PLACE_Y = (-0.20, 0.20)
PLACE_YAW = (-math.pi, math.pi)
SETTLE_STEPS = 100  # physics steps after placing, before the first observation

PALM_STEP = 0.025  # m a control step at action 1 (`ee_delta`): 0.5 m/s
PALM_TURN = 0.125  # rad a control step at action 1 (`ee_delta`): 2.5 rad/s
CLOUD_POINTS = 1024
