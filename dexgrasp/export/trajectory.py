"""The open-loop trajectory of a grasp: approach, close, squeeze, lift, at the rates of the arm and of the hand.

Its path is a spline through the points; how far along it the robot is follows a jerk-limited law (ruckig) within limits
of velocity, acceleration and jerk. A trajectory stretched in time by k has 1/k of the velocity, 1/k^2 of the
acceleration and 1/k^3 of the jerk, so the factor that the limits ask for is known from one sampling.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dexgrasp.grasp.record import PLACING
from dexgrasp.grasp.trajectory import limit_shares
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
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
    """Trajectory from rest to rest, as rows of joint positions.

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
    paths = (np.clip(path, low, high) for path in (*way[:4], *way.placing))
    approach, grasp, squeeze, up, *placing = paths
    way = Waypoints(approach, grasp, squeeze, up, tuple(placing))
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
        rows.append(np.concatenate([timed(path, law), np.repeat(path[-1:], round(pause / ARM_TICK), axis=0)]))
        end = start + len(rows[-1])
        segments.append((name, start * ARM_TICK, end * ARM_TICK))
        start = end
    everything = np.concatenate(rows)
    return Trajectory(robot, everything[:, :hand], everything[::HAND_EVERY, hand:], tuple(segments))


class Limits(NamedTuple):
    """Limits of n joints: rad/s, rad/s^2, rad/s^3."""

    velocity: Array
    acceleration: Array
    jerk: Array


def timed(path: Array, limits: Limits) -> Array:
    """Return rows (T, n) rad along a path, one an `ARM_TICK`, from rest at its first point to rest at its last.

    Args:
        path: (m, n) rad.
        limits: of the joints.

    Returns:
        The rows after the first point of the path, the last held until T is a multiple of `HAND_EVERY`; none where the
        path goes nowhere.

    Raises:
        InputError: if no law keeps the limits.
    """
    points = _thinned(path)
    if len(points) < 2:
        return points[:0]
    spline, length = _spline(points)
    slow = 1.0
    for _ in range(20):
        rows = spline(_law(length, slow))
        rows[-1] = points[-1]
        used = np.array(limit_shares(np.concatenate([points[:1], rows]), ARM_TICK, *limits))
        # Share of every limit that is planned for; finite differences of the rows then stay below 0.95.
        # k times slower, velocity, acceleration and jerk fall k, k^2 and k^3 times.
        excess = (used ** (1.0 / np.arange(1, 4))).max() / 0.90
        if excess <= 1.0:
            return np.concatenate([rows, np.repeat(rows[-1:], -len(rows) % HAND_EVERY, axis=0)])
        slow *= 1.02 * excess
    raise InputError("the path cannot be timed within the limits of the joints: it bends too sharply")


def _thinned(path: Array) -> Array:
    kept = [path[0]]
    apart = 0.004  # rad: nearer points bend the spline for nothing
    for point in path[1:-1]:
        if np.abs(point - kept[-1]).max() >= apart and np.abs(point - path[-1]).max() >= apart:
            kept.append(point)
    if np.abs(path[-1] - kept[-1]).max() > 1e-9:
        kept.append(path[-1])
    return np.array(kept)


def _spline(points: Array) -> tuple[Callable[[Array], Array], float]:
    """Return a smooth curve through the points by its length along their polygon, and that length."""
    from scipy.interpolate import make_interp_spline

    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    degree = {2: 1, 3: 2, 4: 3, 5: 3}.get(len(points), 5)
    return make_interp_spline(along, points, k=degree), float(along[-1])


def _law(length: float, slow: float) -> Array:
    """Return positions (T,) along a path of some length, jerk-limited, one an `ARM_TICK` after the start."""
    from ruckig import InputParameter, Ruckig, Trajectory

    parameters, trajectory = InputParameter(1), Trajectory(1)
    parameters.current_position, parameters.target_position = [0.0], [length]
    for name in ("current_velocity", "current_acceleration", "target_velocity", "target_acceleration"):
        setattr(parameters, name, [0.0])
    parameters.max_velocity, parameters.max_acceleration = [2.0 / slow], [8.0 / slow**2]
    parameters.max_jerk = [200.0 / slow**3]
    Ruckig(1).calculate(parameters, trajectory)
    times = ARM_TICK * np.arange(1, int(np.ceil(trajectory.duration / ARM_TICK)) + 1)
    return np.array([min(trajectory.at_time(min(t, trajectory.duration))[0][0], length) for t in times])
