"""The open-loop trajectory of a grasp: approach, close, squeeze, lift, at the rates of the arm and of the hand."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dexgrasp.export.time_law import Limits, timed
from dexgrasp.grasp.record import PLACING
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.robot import Robot

ARM_TICK = 0.001
"""s between rows of the arm: its controller takes 1 kHz."""
HAND_EVERY = 3
"""Rows of the arm to one of the hand, whose period is 3 ms (333 Hz)."""


class Waypoints(NamedTuple):
    """Paths in joint space that a trajectory is made of, rad.

    Attributes:
        approach: (k, n) from where the robot stands to the pregrasp.
        grasp: (n,) fingertips in contact.
        squeeze: (n,) set-points that press.
        lift: (m, n) from the squeeze up.
        placing: after it carry, set_down, release and retreat, (k, n) each; nothing of a grasp that holds.
    """

    approach: Array
    grasp: Array
    squeeze: Array
    lift: Array
    placing: tuple[Array, ...] = ()


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Rows from rest to rest.

    Attributes:
        robot: whose joints they are.
        arm: (T, a) rad, one a millisecond, the first where the robot stands.
        hand: (1 + (T - 1) / 3, n - a) rad, one every 3 ms.
        segments: name, first and last second of approach, close, squeeze, lift, and of placing.
    """

    robot: Robot
    arm: Array
    hand: Array
    segments: tuple[tuple[str, float, float], ...]


def make_trajectory(way: Waypoints, robot: Robot) -> Trajectory:
    """Time the waypoints within the robot's limits of position, velocity, acceleration and jerk.

    Raises:
        InputError: if a path cannot be timed within them.
    """
    room = 0.003  # rad: the spline swings out by a part of it between points
    low, high = robot.lower + room, robot.upper - room
    approach, grasp, squeeze, up = (np.clip(path, low, high) for path in way[:4])
    way = Waypoints(approach, grasp, squeeze, up, tuple(np.clip(path, low, high) for path in way.placing))
    # The hand's rows are three ticks apart: a law that keeps the limits at 1 ms keeps them at 3 ms.
    limits = Limits(robot.velocity, robot.acceleration, robot.jerk)
    # share of the hand's speed that closing and pressing use: fingertips meet the object gently
    gentle = limits._replace(velocity=0.05 * limits.velocity)
    share = 0.25  # of the arm's speed and acceleration: what is held should stay held
    steady = Limits(share * limits.velocity, share**2 * limits.acceleration, limits.jerk)
    hand = robot.arm_dof
    closed, pressing = (
        np.r_[way.approach[-1, :hand], posture[hand:]] for posture in (way.grasp, way.squeeze)
    )
    lift = np.concatenate([pressing[None], way.lift])
    lift[:, hand:] = pressing[hand:]  # closing moves the hand alone, lifting the arm
    rest = 0.3  # s, after the approach, and before the lift
    pieces = [
        ("approach", way.approach, limits, rest),
        ("close", np.stack([way.approach[-1], closed]), gentle, 0.0),
        ("squeeze", np.stack([closed, pressing]), gentle, rest),
        ("lift", lift, steady, 0.0),
    ]
    for name, law, path in zip(PLACING, (steady, steady, gentle, steady), way.placing, strict=False):
        if name != "release":
            path[:, hand:] = (pressing if name in PLACING[:2] else way.approach[-1])[hand:]
        path[0] = pieces[-1][1][-1]
        pieces.append((name, path, law, rest))
    rows, segments, start = [way.approach[:1]], [], 0
    for name, path, law, pause in pieces:
        rows += [
            timed(path, law, ARM_TICK, HAND_EVERY),
            np.repeat(path[-1:], round(pause / ARM_TICK), axis=0),
        ]
        end = start + len(rows[-2]) + len(rows[-1])
        segments.append((name, start * ARM_TICK, end * ARM_TICK))
        start = end
    everything = np.concatenate(rows)
    return Trajectory(robot, everything[:, :hand], everything[::HAND_EVERY, hand:], tuple(segments))
