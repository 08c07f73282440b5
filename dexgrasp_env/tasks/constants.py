"""Constants of the tasks: success, placement, motion, goals and neighbours."""

import math

from dexgrasp_env.scene.constants import CONTROL_STEPS

LIFT_HEIGHT = 0.10  # m, lowest point of the object above the table
HOLD_STEPS = 60  # control steps at 20 Hz: 3 s
MAX_EPISODE_STEPS = 300  # control steps: 15 s
CLUTTER_EPISODE_STEPS = 600  # in which a lost object can be grasped again
CLEAR_STEPS = 400  # an object that is to be put into a tray
HEAP_EPISODE_STEPS = 1800  # in which eight neighbours can be set aside first

GRASP_FORCE = 0.5  # N: a finger that presses the object at least so much takes part in the grasp
GRASP_STEPS = 54  # of the hold's steps, 90 %: so many must be grasps

STABLE_SLIP = 0.025  # m of motion in the hand's frame during lift and hold
STABLE_TILT = math.radians(15.0)
OFF_TABLE = 0.002  # m: from here on the object counts as lifted off

DISTURB_AFTER = 20  # control steps held, 1 s, after which the disturbance begins
DISTURB_SHIFT = 0.06  # m of motion in the palm's frame that a held object may make under it

# Where an object may be before it counts as lost: centre, world frame, m.
WORKSPACE_LOW = (0.05, -0.65, -0.05)
WORKSPACE_HIGH = (1.05, 0.65, 1.30)

PLACE_X = (0.42, 0.60)  # m; the arm reaches every yaw here (92 % at 0.70)
PLACE_Y = (-0.20, 0.20)
SETTLE_STEPS = 100  # physics steps after placing, before the first observation

PALM_STEP = 0.025  # m a control step at action 1 (`ee_delta`): 0.5 m/s
PALM_TURN = 0.125  # rad a control step at action 1 (`ee_delta`): 2.5 rad/s
AROUND_POINTS = 4096  # of what stands around the object

SHORTEST_SKIP = 5  # physics steps of a control step: 100 Hz

MOST_NEIGHBOURS = 25
STILL = 1e-4  # of poses, m and parts of a quaternion, by which nothing moves in a span of rest
NEIGHBOUR_MOVED = 0.02  # m: a lift that moved nothing farther is clean
TOPPLED = math.radians(30.0)  # a neighbour whose vertical has turned so far has toppled

GOAL_STEPS = 20  # control steps there, 1 s, that make a success


def at_pace(steps: int, frame_skip: int) -> int:
    """Return how many control steps of `frame_skip` physics steps take as long as `steps` at 20 Hz, rounded up."""
    return -(-steps * CONTROL_STEPS // frame_skip)
