"""Disturbances: pushes of the held object in six directions, shaking of the arm, motion of the object beforehand.

Pushes and shaking begin once the object has been held for 1 s, while the agent acts on. A belt in the table carries
objects that move before they are grasped, for a moment or steadily.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.random import Generator

from dexgrasp_env.arrays import AnyArray, Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import quat_conjugate, rotate
from dexgrasp_env.tasks.constants import PLACE_X, PLACE_Y, at_pace
from dexgrasp_env.valid import number, one_of, read

KINDS = ("none", "pushed", "shaken", "moved", "belt")
PUSH_STEPS = 10  # control steps of one push, 0.5 s
PAUSE_STEPS = 4  # control steps between pushes, 0.2 s
MOTION = np.dtype(
    [("starts", "i8"), ("ends", "i8"), ("twist", "f8", (3,)), ("steady", "?"), ("now", "f8", (3,))]
)
"""Motion of an episode's object: control steps after which it starts and ends, m/s along x and y and rad/s about z,
whether it goes on when the hand touches the object, and what moves in the present control step."""
MOVE_STEPS = 10  # control steps that a displacement takes, 0.5 s


@dataclass(frozen=True)
class Disturbance:
    """Disturbance of an object: its kind and size.

    Attributes:
        kind: `none`; `pushed`: along +x, -x, +y, -y, +z, -z of the world, 0.5 s each and 0.2 s apart; `shaken`: 2 s of
            sines on the set-points of panda_joint1 (0.06 rad, 3 Hz) and panda_joint4 (0.04 rad, 2.4 Hz); `moved`:
            displaced within 0.5 s, 0.2 to 1.5 s after the start, by up to `size` and turned by up to 60 deg, unless the
            hand touches it; `belt`: carried along y all the time.
        size: of a push, in multiples of the object's true weight; of the shaking, a factor on its amplitudes; cm of a
            displacement; cm/s of a belt.
    """

    kind: Annotated[str, one_of(KINDS)] = "none"
    size: Annotated[float, number(ge=0, le=10)] = 1.0

    def __post_init__(self) -> None:
        if self.kind == "none" and self.size != 1.0:
            raise InputError(f"disturbance none has size {self.size:g}, which changes nothing: leave it out")

    @property
    def moves(self) -> bool:
        """True where the object moves before it is grasped."""
        return self.kind in ("moved", "belt")

    def steps_at(self, frame_skip: int) -> int:
        """Return how long it lasts, control steps of so many physics steps."""
        push, pause = at_pace(PUSH_STEPS, frame_skip), at_pace(PAUSE_STEPS, frame_skip)
        shaken = at_pace(40, frame_skip)  # control steps, 2 s
        return {"pushed": 6 * push + 5 * pause, "shaken": shaken}.get(self.kind, 0)

    @classmethod
    def of(cls, value: "Disturbance | Mapping[str, Any] | str") -> "Disturbance":
        """Return a disturbance from its name or a mapping of its attributes.

        Raises:
            InputError: for an unknown kind or key, a size that is not a number of 0 to 10, or one of `none`.
        """
        return read(cls, {"kind": value} if isinstance(value, str) else value, "disturbance")


def draw_motion(disturbance: Disturbance, pose: Array, frame_skip: int, rng: Generator) -> AnyArray:
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


def moves_now(motions: AnyArray, records: AnyArray) -> Array:
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
