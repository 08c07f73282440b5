"""The open-loop trajectory of a grasp: approach, close, squeeze, lift, at the rates of the arm and of the hand."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dexgrasp.export.time_law import Limits, timed
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.limits import (
    ARM_ACCELERATION,
    ARM_JERK,
    ARM_VELOCITY,
    HAND_ACCELERATION,
    HAND_JERK,
    HAND_VELOCITY,
    LOWER,
    UPPER,
)

ARM_TICK = 0.001
"""s between rows of the arm: its controller takes 1 kHz."""
HAND_EVERY = 3
"""Rows of the arm to one of the hand, whose period is 3 ms (333 Hz)."""
_LIMITS = Limits(
    np.concatenate([ARM_VELOCITY, HAND_VELOCITY]), np.concatenate([ARM_ACCELERATION, HAND_ACCELERATION]),
    np.concatenate([ARM_JERK, HAND_JERK]),
)  # fmt: skip
# The hand's rows are three ticks apart; limits hold for these too, as a law that keeps them at 1 ms keeps them at 3 ms.
_CLOSING = 0.05  # share of the hand's speed that closing and pressing use: fingertips meet the object gently
_LIFTING = 0.25  # share of the arm's speed and acceleration that the lift uses: what is held should stay held
_ROOM = 0.003  # rad from the ends of the joints' ranges: the spline swings out by a part of it between points
_PAUSE = 0.3  # s of rest after the approach, and before the lift


class Waypoints(NamedTuple):
    """What a trajectory is made of: paths in joint space, rad.

    Attributes:
        approach: (n, 23) from where the robot stands to the pregrasp.
        grasp: (23,) fingertips in contact.
        squeeze: (23,) set-points that press.
        lift: (m, 23) from the squeeze up.
    """

    approach: Array
    grasp: Array
    squeeze: Array
    lift: Array


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Rows from rest to rest.

    Attributes:
        arm: (T, 7) rad, one a millisecond, the first where the robot stands.
        hand: (1 + (T - 1) / 3, 16) rad, one every 3 ms.
        segments: name, first and last second of approach, close, squeeze and lift.
    """

    arm: Array
    hand: Array
    segments: tuple[tuple[str, float, float], ...]


def make_trajectory(way: Waypoints) -> Trajectory:
    """Time the waypoints within the limits of position, velocity, acceleration and jerk.

    Raises:
        InputError: if a path cannot be timed within them.
    """
    way = Waypoints(*(np.clip(path, LOWER + _ROOM, UPPER - _ROOM) for path in way))
    gentle = Limits(_CLOSING * _LIMITS.velocity, _LIMITS.acceleration, _LIMITS.jerk)
    steady = Limits(_LIFTING * _LIMITS.velocity, _LIFTING**2 * _LIMITS.acceleration, _LIMITS.jerk)
    open_ = way.approach[-1]
    closed, pressing = _hand_of(open_, way.grasp), _hand_of(open_, way.squeeze)
    lift = np.concatenate([way.lift[:, :7], np.repeat(pressing[None, 7:], len(way.lift), axis=0)], axis=1)
    lift = np.concatenate([pressing[None], lift])
    pieces = [
        ("approach", timed(way.approach, _LIMITS, ARM_TICK, HAND_EVERY), _PAUSE),
        ("close", timed(np.stack([open_, closed]), gentle, ARM_TICK, HAND_EVERY), 0.0),
        ("squeeze", timed(np.stack([closed, pressing]), gentle, ARM_TICK, HAND_EVERY), _PAUSE),
        ("lift", timed(lift, steady, ARM_TICK, HAND_EVERY), 0.0),
    ]
    rows, segments, last = [way.approach[:1]], [], way.approach[0]
    count = 0
    for name, piece, pause in pieces:
        last = piece[-1] if len(piece) else last
        rows += [piece, np.repeat(last[None], round(pause / ARM_TICK), axis=0)]
        end = count + len(rows[-2]) + len(rows[-1])
        segments.append((name, count * ARM_TICK, end * ARM_TICK))
        count = end
    everything = np.concatenate(rows)
    return Trajectory(everything[:, :7], everything[::HAND_EVERY, 7:], tuple(segments))


def _hand_of(arm: Array, hand: Array) -> Array:
    """The arm of one configuration with the hand of another: closing moves the hand alone."""
    return np.concatenate([arm[:7], hand[7:]])
