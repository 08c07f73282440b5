"""The grasp space, compiled: an action is where the palm goes about the object, and how far the hand closes.

In an action space of joints, or of steps of the palm, a grasp is a long run of numbers that all have to be right, and
exploring by noise hardly ever meets it. Here a grasp is nearly one point, and its phases are a few of them: palm above,
down, hand closed, palm up. This module imports numba: it is imported when an environment is made.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from dexgrasp_env.arrays import Array, Index, Single
from dexgrasp_env.assets import asset_path
from dexgrasp_env.compiled import njit
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import quat_to_matrix, rotation_components
from dexgrasp_env.robot.robot import Robot
from dexgrasp_env.tasks.constants import (
    DISTURB_AFTER,
    PALM_STEP,
    PALM_TURN,
    PLACE_X,
    PLACE_Y,
    at_pace,
)
from dexgrasp_env.tasks.control import GRASP_SIZE, ONCE_MODES
from dexgrasp_env.tasks.records import PALM, PALM_QUAT, Record
from dexgrasp_env.tasks.settings import LiftSettings
from dexgrasp_env.tasks.simulation import Simulation
from dexgrasp_env.yaml_file import read_yaml

_rotation = njit(rotation_components)

_TABLE = read_yaml(asset_path("grasp_space.yaml"))
"""Places of the palm and postures of the hand; the file says what they are."""
_PLACE = GRASP_SIZE - 2  # numbers of an action that are of the palm
_LEAST_Z = 0.12  # m above the table, where the tips still clear it
_GAIN, _FASTEST = 0.5, 0.8  # share of what is left that a control step goes, and of what it can go at most
_CLOSING = 0.1  # rad that a joint of the hand moves in a control step at most
_BESIDE, _HIGHEST = 0.03, 0.25  # m beside where objects are put, and above the table, that palms go to
_TURNS = np.deg2rad(np.arange(0.0, 180.0, 3.0))
_WIDER = 1.03, 0.003  # factor and m by which a grip may be wider than the narrowest

_PHASES = 32, 24, 28, 90  # control steps at 20 Hz: over the object, down, closing, lifted and held
FRAME = 11
"""Numbers of the frame of an episode's grasps, `grasp_frame`."""
_OVER = 0.15  # m above the top of the object, from where a whole grasp comes straight down
_LIFTED = 0.2  # m that it lifts
_UP_BY = 30  # control steps at 20 Hz after closing, by which the object is up if it ever is


class GraspSpace(NamedTuple):
    """Constants of the grasp space of a robot with a hand of m joints, and of the phases of a whole grasp.

    Attributes:
        places: (5, 2) middle and span, of the palm's places.
        opened: (m,) rad, the open hand.
        closing: (2, m) rad, what it is bent by as fingers and thumb close.
        hand: (2, m) rad, ends of its joints.
        ends: (3,) control steps after which phases of a whole grasp end; the last ends with the episode.
        whole: whether an action is a whole grasp.
    """

    places: Array
    opened: Array
    closing: Array
    hand: Array
    ends: Index
    whole: bool


def grasp_space(settings: LiftSettings) -> GraspSpace:
    """Return the grasp space of an environment.

    Raises:
        InputError: for a hand that has no postures here.
    """
    robot = settings.cell.robot
    fingers, opened = robot.hand.fingers, _TABLE["open"]
    if any(len(opened.get(finger.name, ())) != len(finger.joints) for finger in fingers):
        raise InputError(
            f"control_mode {settings.control_mode!r} has postures of the fingers {', '.join(opened)}, with four joints "
            f"each: the hand {robot.hand.name!r} has {', '.join(finger.name for finger in fingers)}"
        )
    hand = robot.hand_columns
    ends = [at_pace(steps, settings.frame_skip) for steps in np.cumsum(_PHASES[:-1]).tolist()]
    return GraspSpace(
        np.array(list(_TABLE["places"].values())),
        joint_changes(robot, {"open": opened})[0, hand],
        joint_changes(robot, _TABLE["closed"])[:, hand],
        np.stack([robot.lower[hand], robot.upper[hand]]),
        np.array(ends, np.int64),
        settings.control_mode in ONCE_MODES,
    )


def lifted_by(settings: LiftSettings) -> int:
    """Return the control steps after which a whole grasp whose object is not up is over."""
    return at_pace(sum(_PHASES[:-1]) + _UP_BY, settings.frame_skip)


def longest_grasp(settings: LiftSettings) -> int:
    """Return the control steps that a whole grasp takes at most: its phases, and a disturbance."""
    disturbed = settings.disturbance_steps
    return at_pace(sum(_PHASES) + (DISTURB_AFTER if disturbed else 0), settings.frame_skip) + disturbed


def joint_changes(robot: Robot, table: Mapping[str, Mapping[str, Sequence[float]]]) -> Array:
    """Return the joint angles (n,) rad that each entry of a table, by finger, adds."""
    rows = np.zeros((len(table), robot.dof))
    for row, fingers in zip(rows, table.values(), strict=True):
        for finger, angles in fingers.items():
            row[robot.columns[finger].start :][: len(angles)] = angles
    return rows


def home_yaw(simulation: Simulation) -> float:
    """Return the level direction, rad, that the palm faces where the robot begins."""
    data = mujoco.MjData(simulation.base)
    data.qpos[: simulation.cell.robot.dof] = simulation.cell.robot.home
    mujoco.mj_forward(simulation.base, data)
    R = quat_to_matrix(data.sensordata[simulation.columns[PALM_QUAT] :][:4])
    return float(np.arctan2(R[1, 2], R[0, 2]))


def grasp_frame(record: Record, yaw: float) -> Array:
    """Return the frame (FRAME,) of an episode's grasps: where the object lay at first.

    Args:
        record: of the episode.
        yaw: `home_yaw`.

    Returns:
        The middle of its top, m; the level direction that closes on it, rad; middle and span of heights above it, m;
        spans of turns from that direction, rad, and of the ways along and across it, m; the height above it from where
        a whole grasp comes straight down, m; the level direction of these ways, rad.
    """
    pose, half = record["laid"], record["half_extents"]
    R = quat_to_matrix(pose[3:])
    top = pose[2] + float((np.abs(R[2]) * half).sum())
    # No part of an action's range is under the table, where it would make no difference.
    middle, span = _TABLE["places"]["above"]
    lowest = max(middle - span, _LEAST_Z - top)
    high = middle + span
    # The narrowest grip that turns the wrist least, by 90 degrees at most, as grips are alike that are turned by 180:
    # of round things all are as narrow.
    level = np.stack([np.cos(_TURNS), np.sin(_TURNS)], axis=1)
    widths = (np.abs((R[:2, :, None] * level.T[:, None]).sum(axis=0)) * (2.0 * half)[:, None]).sum(axis=0)
    narrow = widths <= widths.min() * _WIDER[0] + _WIDER[1]
    off = (_TURNS - yaw + 0.5 * np.pi) % np.pi - 0.5 * np.pi
    best = np.argmin(np.where(narrow, np.abs(off), np.inf))
    heights = 0.5 * (high + lowest), 0.5 * (high - lowest)
    spans = (_TABLE["places"][name][1] for name in ("turned", "along", "across"))
    axis = yaw + off[best]
    return np.array([*pose[:2], top, axis, *heights, *spans, _OVER, axis])


def table_frame(yaw: float) -> Array:
    """Return the frame (FRAME,) of grasps at any place on the table, as `grasp_frame`; heights are above the table.

    Args:
        yaw: `home_yaw`, which is turned from by a right angle at most.
    """
    (x0, x1), (y0, y1) = PLACE_X, PLACE_Y
    half, beside = 0.5 * (x1 - x0) + _BESIDE, 0.5 * (y1 - y0) + _BESIDE
    low, high = _LEAST_Z, _HIGHEST
    heights = 0.5 * (low + high), 0.5 * (high - low)
    return np.array(
        [0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.0, yaw, *heights, 0.5 * math.pi, half, beside, high + _OVER, 0.0]
    )


@njit
def palm_actions(
    actions: Array,
    step: int,
    frames: Array,
    commands: Array,
    sensors: Array,
    at: Index,
    space: GraspSpace,
    out: Array,
) -> None:
    """Write the actions of `ee_delta` that go one control step towards grasp actions.

    Args:
        actions: (N, 7); what lies beyond -1 and 1 is mirrored there.
        step: control steps since the actions were given.
        frames: (N, FRAME), of `grasp_frame`.
        commands: (N, 3, n) rad, `COMMANDS`.
        sensors: (N, ...) `sensordata`.
        at: first columns of the readings there.
        space: of the robot.
        out: (N, 6 + m) out.
    """
    for i in range(len(actions)):
        _palm_action(actions[i], step, frames[i], commands[i, 0], sensors[i], at, space, out[i])


@njit
def _palm_action(
    action: Array, step: int, frame: Array, targets: Array, s: Array, at: Index, space: GraspSpace, out: Array
) -> None:
    a = np.empty(GRASP_SIZE)
    for k in range(GRASP_SIZE):
        a[k] = _folded(action[k])
    along, across = frame[7] * a[0], frame[8] * a[1]
    above = frame[4] + frame[5] * a[2]
    if space.whole:
        if step < space.ends[0]:
            above = max(above, frame[9])
        elif step >= space.ends[2]:
            above += _LIFTED
        if step < space.ends[1]:
            a[5] = a[6] = -1.0
    yaw = frame[3] + frame[6] * a[3]
    tilt = space.places[4, 0] + space.places[4, 1] * a[4]
    cosine, sine = math.cos(frame[10]), math.sin(frame[10])
    palm = at[PALM]
    x = (frame[0] + cosine * along - sine * across - s[palm]) / PALM_STEP
    y = (frame[1] + sine * along + cosine * across - s[palm + 1]) / PALM_STEP
    z = (frame[2] + above - s[palm + 2]) / PALM_STEP
    _write_step(x, y, z, out, 0)
    q = at[PALM_QUAT]
    x, y, z = _turn(yaw, tilt, _rotation(s[q], s[q + 1], s[q + 2], s[q + 3]))
    _write_step(x / PALM_TURN, y / PALM_TURN, z / PALM_TURN, out, 3)
    first = len(targets) - len(space.opened)
    for j in range(len(space.opened)):
        bent = space.opened[j]
        for k in range(2):
            bent += 0.5 * (a[_PLACE + k] + 1.0) * space.closing[k, j]
        now = targets[first + j]
        now += min(max(bent - now, -_CLOSING), _CLOSING)
        low, high = space.hand[0, j], space.hand[1, j]
        out[6 + j] = min(max(2.0 * (now - low) / (high - low) - 1.0, -1.0), 1.0)


@njit
def _folded(a: float) -> float:
    """Return a number within -1 and 1, mirrored there as often as it takes.

    Were it clipped, a mean that has wandered off beyond an end would never hear of anything else again.
    """
    return 1.0 - abs((a + 1.0) % 4.0 - 2.0)


@njit
def _turn(yaw: float, tilt: float, R: tuple[float, ...]) -> tuple[float, float, float]:
    """Return the rotation vector, rad, from a palm's rotation R to that which hangs, facing `yaw`, its thumb tilted."""
    c, s, ct, st = math.cos(yaw), math.sin(yaw), math.cos(tilt), math.sin(tilt)
    wanted = (-st * c, -s, ct * c), (-st * s, c, ct * s), (-ct, 0.0, -st)
    M = np.zeros((3, 3))  # the wanted rotation times the transpose of R
    for i in range(3):
        for j in range(3):
            for k in range(3):
                M[i, j] += wanted[i][k] * R[3 * j + k]
    a, b, d = 0.5 * (M[2, 1] - M[1, 2]), 0.5 * (M[0, 2] - M[2, 0]), 0.5 * (M[1, 0] - M[0, 1])
    sine, cosine = math.sqrt(a * a + b * b + d * d), 0.5 * (M[0, 0] + M[1, 1] + M[2, 2] - 1.0)
    share = math.atan2(sine, cosine) / max(sine, 1e-9)
    return a * share, b * share, d * share


@njit
def _write_step(x: float, y: float, z: float, out: Array, first: int) -> None:
    """Write the step (3,) of what is left, in its direction."""
    length = _GAIN * math.sqrt(x * x + y * y + z * z)
    share = _GAIN * min(1.0, _FASTEST / max(length, 1e-9))
    out[first], out[first + 1], out[first + 2] = share * x, share * y, share * z


@njit
def grasp_states(
    frames: Array, positions: Array, sensors: Array, at: Index, space: GraspSpace, out: Single
) -> None:
    """Write the states of palm and hand, (N, 7), as the actions that would leave them where they are.

    Args:
        frames: (N, FRAME), of `grasp_frame`.
        positions: (N, n, ...) rad, of the robot's joints, as measured.
        sensors: (N, ...) `sensordata`.
        at: first columns of the readings there.
        space: of the robot.
        out: (N, 7) float32 out.
    """
    for i in range(len(frames)):
        s, frame, p, q = sensors[i], frames[i], at[PALM], at[PALM_QUAT]
        R = _rotation(s[q], s[q + 1], s[q + 2], s[q + 3])
        x, y, yaw = s[p] - frame[0], s[p + 1] - frame[1], math.atan2(R[5], R[2])
        cosine, sine = math.cos(frame[10]), math.sin(frame[10])
        out[i, 0] = (cosine * x + sine * y) / frame[7]
        out[i, 1] = (cosine * y - sine * x) / frame[8]
        out[i, 2] = (s[p + 2] - frame[2] - frame[4]) / frame[5]
        turned = (yaw - frame[3] + math.pi) % (2.0 * math.pi) - math.pi
        out[i, 3] = turned / frame[6]
        tilted = math.asin(min(max(-R[8], -1.0), 1.0))
        out[i, 4] = (tilted - space.places[4, 0]) / space.places[4, 1]
        for k in range(2):
            bent = square = 0.0
            for j in range(len(space.opened)):
                joint = positions[i, positions.shape[1] - len(space.opened) + j]
                bent += (joint - space.opened[j]) * space.closing[k, j]
                square += space.closing[k, j] * space.closing[k, j]
            out[i, _PLACE + k] = 2.0 * bent / square - 1.0
