"""Objects that move before they are grasped: a belt in the table carries them, for a moment or steadily."""

import math

import numpy as np
from numpy.random import Generator

from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import quat_conjugate, rotate
from dexgrasp_env.tasks.constants import PLACE_X, PLACE_Y, at_pace
from dexgrasp_env.tasks.disturbance import Disturbance
from dexgrasp_env.tasks.records import Records

MOTION = np.dtype(
    [("starts", "i8"), ("ends", "i8"), ("twist", "f8", (3,)), ("steady", "?"), ("now", "f8", (3,))]
)
"""Motion of an episode's object: control steps after which it starts and ends, m/s along x and y and rad/s about z,
whether it goes on when the hand touches the object, and what moves in the present control step."""
MOVE_STEPS = 10  # control steps that a displacement takes, 0.5 s


def draw_motion(disturbance: Disturbance, pose: Array, frame_skip: int, rng: Generator) -> Records:
    """Return the motion, a `MOTION`, of an object that lies at a pose (7,): its way leads over the table's middle.

    A displacement is even in a disc, and mirrored where it would leave the area that objects are placed in; a belt runs
    along y, towards the far side.
    """
    u, size = rng.random(4), 0.01 * disturbance.size
    if disturbance.kind == "belt":
        forever = 1 << 40  # control steps
        return np.array((0, forever, (0.0, -math.copysign(size, pose[1]), 0.0), True, np.zeros(3)), MOTION)
    seconds = MOVE_STEPS / 20
    speed, direction = size * math.sqrt(u[0]) / seconds, 2.0 * math.pi * u[1]
    twist = [
        speed * math.cos(direction),
        speed * math.sin(direction),
        (2.0 * u[2] - 1.0) * math.radians(60.0) / seconds,
    ]
    for k, (low, high) in enumerate((PLACE_X, PLACE_Y)):
        twist[k] *= 1.0 if low <= pose[k] + seconds * twist[k] <= high else -1.0
    soonest, latest = 4, 30  # control steps after which it begins
    starts = at_pace(round(soonest + u[3] * (latest - soonest)), frame_skip)
    return np.array((starts, starts + at_pace(MOVE_STEPS, frame_skip), twist, False, np.zeros(3)), MOTION)


def moves_now(motions: Records, records: Records) -> Array:
    """Advance how the objects of N episodes move, and return it, (N, 6): `MOTION`'s twist, and what it has changed."""
    elapsed = records["elapsed"]
    moves = (motions["starts"] < elapsed) & (elapsed <= motions["ends"])
    moves &= motions["steady"] | ~records["touched"]
    before, motions["now"] = motions["now"].copy(), np.where(moves[:, None], motions["twist"], 0.0)
    return np.hstack([motions["now"], motions["now"] - before])


def drive_belt(qpos: Array, qvel: Array, n: int, moves: Array) -> None:
    """Put the belt under the object and set its velocity; change the object's by as much, so that nothing slips.

    Args:
        qpos: of one scene: robot, object, belt; written to.
        qvel: likewise.
        n: joints of the robot.
        moves: (6,) of `moves_now`.
    """
    twist, change = moves[:3], moves[3:]
    qvel[n : n + 2] += change[:2]
    qvel[n + 3 : n + 6] += rotate(quat_conjugate(qpos[n + 3 : n + 7]), np.array([0.0, 0.0, change[2]]))
    qpos[-7:] = qpos[n], qpos[n + 1], 0.0, 1.0, 0.0, 0.0, 0.0
    qvel[-6:] = twist[0], twist[1], 0.0, 0.0, 0.0, twist[2]
