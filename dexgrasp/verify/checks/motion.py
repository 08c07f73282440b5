"""Set-points: do they open, touch and press as claimed, and are approach and lift ways that the robot can go."""

from itertools import pairwise

import numpy as np

from dexgrasp.grasp.path import bend, jerkiness, stray
from dexgrasp.grasp.record import GraspRecord, Segment
from dexgrasp.verify.checks.check import ROUNDING, Check, at_least, at_most, same
from dexgrasp.verify.checks.contacts import RING
from dexgrasp.verify.checks.scene import Scene, Touch
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.limits import ACCELERATION, HOME, LOWER, UPPER, VELOCITY
from dexgrasp_env.scene.constants import CONTROL_PERIOD

TIPS_MEET = 3e-4  # m: how well the inverse kinematics meets the contacts
TIPS_OPEN = 0.045  # m that the open tips may be from their contacts
SETPOINT = 1e-6  # rad: what two ways to compute a set-point may differ by
BEND = 2.5e-3  # rad that a set-point may stand out of its neighbours' plane
STRAY = 0.01  # m that the palm may stray on the way up
JERK = 4e-3  # rad that a set-point of the lift may lie from its neighbours' cubic
RISE = 5e-4  # m that the lift may miss its height by
_SAME_BEND, _SAME_STRAY = 1e-8, 2e-6  # rad, m
_DENSE = 0.02  # rad of any joint between two states checked for collisions


def setpoint_checks(record: GraspRecord, scene: Scene, touch: Touch) -> list[Check]:
    """Check pregrasp, grasp and squeeze against configuration, contacts and forces."""
    a, radius = record.arrays, record.thresholds.tip_radius
    names = ("pregrasp", "grasp", "squeeze")
    met = touch.points + radius * touch.normals
    closed, opened = scene.touch(a["grasp"]).tips, scene.touch(a["pregrasp"]).tips
    return [
        same("arm still", max(float(np.abs(a[n][:7] - a["q"][:7]).max()) for n in names), ROUNDING, "rad"),
        same("ring still", max(float(np.abs(a[n][RING] - a["q"][RING]).max()) for n in names), ROUNDING, "rad"),
        at_most("grasp: tips from the surface", _farthest(closed - met), TIPS_MEET, "m"),
        at_most("pregrasp: tips from their contacts", _farthest(opened - met), TIPS_OPEN, "m"),
        same("squeeze = grasp + J^T f / kp", _press_error(record, scene), SETPOINT, "rad"),
    ]  # fmt: skip


def _farthest(offsets: Array) -> float:
    return float(np.linalg.norm(offsets, axis=1).max())


def _press_error(record: GraspRecord, scene: Scene) -> float:
    """Position servos whose set-points are J^T f / kp further in press with f; the joint range ends them."""
    a, gain = record.arrays, scene.model.actuator_gainprm[7:23, 0]
    scene.place(a["grasp"])
    torque = np.einsum("frj,fr->j", scene.jacobians(a["contacts"]), a["forces"])
    expected = np.clip(a["grasp"][7:] + torque / gain, LOWER[7:], UPPER[7:])
    return float(np.abs(a["squeeze"][7:] - expected).max())


def approach_checks(record: GraspRecord, scene: Scene) -> list[Check]:
    """Check the way from home to the pregrasp."""
    segment = record.approach
    if segment is None:
        return [Check("approach given", 1.0, "in the file", False)]
    rows = segment.setpoints
    found, (row, depth) = bend(rows), scene.first_contact(_dense(rows))
    return [
        *_segment_checks("approach", segment),
        same("approach starts at home", float(np.abs(rows[0] - HOME).max()), SETPOINT, "rad"),
        same("approach ends at the pregrasp", float(np.abs(rows[-1] - record.arrays["pregrasp"]).max()), ROUNDING),
        at_most("approach: collision", depth if row >= 0 else 0.0, 0.0, "m"),
        at_most("approach: bend", found, BEND, "rad"),
        same("approach: bend", abs(found - segment.measure), _SAME_BEND, "rad"),
    ]  # fmt: skip


def lift_checks(record: GraspRecord, scene: Scene) -> list[Check]:
    """Check the way straight up from the squeeze."""
    segment = record.lift
    if segment is None:
        return [Check("lift given", 1.0, "in the file", False)]
    rows = segment.setpoints
    palms = [scene.palm(q) for q in rows]
    positions = np.array([p for p, _ in palms])
    strayed = stray(positions, np.array([R for _, R in palms]))
    rise = positions[:, 2] - positions[0, 2]
    row, depth = scene.first_contact(_dense(rows), with_object=False)
    return [
        *_segment_checks("lift", segment),
        same("lift starts at the squeeze", float(np.abs(rows[0] - record.arrays["squeeze"]).max()), ROUNDING),
        same("lift: fingers still", float(np.abs(rows[:, 7:] - rows[0, 7:]).max()), ROUNDING, "rad"),
        same("lift: height", abs(float(rise[-1]) - record.lift_height), RISE, "m"),
        at_least("lift: rises", float(np.diff(rise).min()), 0.0, "m", 1e-5),
        at_most("lift: stray", strayed, STRAY, "m"),
        same("lift: stray", abs(strayed - segment.measure), _SAME_STRAY, "m"),
        at_most("lift: jerk", jerkiness(rows), JERK, "rad"),
        at_most("lift: collision", depth if row >= 0 else 0.0, 0.0, "m"),
    ]  # fmt: skip


def _segment_checks(name: str, segment: Segment) -> list[Check]:
    """Times, and the limits of position, velocity and acceleration, from rest to rest."""
    rows, expected = segment.setpoints, np.arange(len(segment.times)) * CONTROL_PERIOD
    rest = np.concatenate([rows[:1], rows, rows[-1:]])
    speed = np.abs(np.diff(rest, axis=0)) / CONTROL_PERIOD / VELOCITY
    change = np.abs(np.diff(rest, n=2, axis=0)) / CONTROL_PERIOD**2 / ACCELERATION
    return [
        same(f"{name}: times", float(np.abs(segment.times - expected).max()), ROUNDING, "s"),
        at_least(f"{name}: joint limits", float(np.minimum(rows - LOWER, UPPER - rows).min()), 0.0, "rad", ROUNDING),
        at_most(f"{name}: velocity over its limit", float(speed.max()), 1.0, "", ROUNDING),
        at_most(f"{name}: acceleration over its limit", float(change.max()), 1.0, "", ROUNDING),
    ]  # fmt: skip


def _dense(rows: Array) -> Array:
    """Set-points move straight between control steps: states on the way, no joint moving over `_DENSE` rad."""
    pieces = [rows[:1]]
    for a, b in pairwise(rows):
        count = max(1, int(np.ceil(np.abs(b - a).max() / _DENSE)))
        pieces.append(a + np.arange(1, count + 1)[:, None] / count * (b - a))
    return np.concatenate(pieces)
