"""Checks of set-points: they open, touch and press as claimed, and the robot can go approach and lift."""

import numpy as np

from dexgrasp.grasp.record import Phase
from dexgrasp.grasp.trajectory import bend, densify, jerkiness, limit_shares, stray
from dexgrasp.grasp.verify.case import Case
from dexgrasp.grasp.verify.check import ROUNDING, Check, at_least, at_most, flag, same
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.robot import Robot
from dexgrasp_env.scene.constants import CONTROL_PERIOD

SETPOINT = 1e-6  # rad: what two ways to compute a set-point may differ by


def setpoint_checks(case: Case) -> list[Check]:
    """Check pregrasp, grasp and squeeze against configuration, contacts and forces."""
    record, touch = case.record, case.touch
    moved = np.abs([record.pregrasp, record.grasp, record.squeeze] - record.q)
    met = touch.points + case.limits.tip_radius * touch.normals
    closed, opened = case.scene.touch(record.grasp).tips, case.scene.touch(record.pregrasp).tips
    return [
        same("arm still", moved[:, : case.robot.arm_dof].max(), ROUNDING, "rad"),
        same("idle fingers still", moved[:, case.idle].max(initial=0.0), ROUNDING, "rad"),
        # m: how well the inverse kinematics meets the contacts
        at_most("grasp: tips from the surface", _farthest(_mendable(case, closed - met)), 3e-4, "m"),
        # m that the open tips may be from their contacts
        at_most("pregrasp: tips from their contacts", _farthest(opened - met), 0.045, "m"),
        same("squeeze = grasp + J^T f / kp", _press_error(case), SETPOINT, "rad"),
        *_closing_checks(case),
    ]  # fmt: skip


def _closing_checks(case: Case) -> list[Check]:
    """Check that the hand meets no neighbour on the way on which it closes."""
    if not case.scene.neighbours:
        return []
    found = [
        case.scene.clearances(q, tips_touch=True)["hand_neighbour"]
        for q in densify([case.record.pregrasp, case.record.grasp, case.record.squeeze])
    ]
    return [at_least("closing: clearance hand_neighbour", min(found), 0.0, "m")]


def _mendable(case: Case, missed: Array) -> Array:
    """Return what joints could mend of a miss (N, 3) m below 4 mm; with three a finger that is all of it."""
    case.scene.place(case.record.grasp)
    J = case.scene.jacobians(case.touch.tips, case.touch.normals)[:, :3].reshape(missed.size, -1)
    J = J[:, J.any(0)]
    if J.shape[1] >= missed.size or _farthest(missed) > 0.004:
        return missed
    return (J @ np.linalg.pinv(J) @ missed.ravel()).reshape(missed.shape)


def _farthest(offsets: Array) -> float:
    return np.linalg.norm(offsets, axis=1).max()


def _press_error(case: Case) -> float:
    """Return how far, rad, the squeeze is from grasp + J^T f / kp, where servos press with f, in the joint range."""
    record, robot, scene, hand = case.record, case.robot, case.scene, slice(case.robot.arm_dof, None)
    scene.place(record.grasp)
    torque = np.einsum("frj,fr->j", scene.jacobians(record.points, record.normals), record.forces)
    pressed, (C, c) = record.grasp.copy(), robot.drive
    pressed[hand] = np.clip(pressed[hand] + torque / case.servos[1], robot.lower[hand], robot.upper[hand])
    return np.abs(record.squeeze - C @ pressed - c)[hand].max()


def approach_checks(case: Case) -> list[Check]:
    """Check the way from home to the pregrasp."""
    if case.record.script is None:
        return [flag("approach given", False, "in the file")]
    phase = case.record.script.phases[0]
    rows = phase.setpoints
    found = bend(rows)
    return [
        *phase_checks(phase, case.robot),
        same("approach starts at home", np.abs(rows[0] - case.robot.home).max(), SETPOINT, "rad"),
        same("approach ends at the pregrasp", np.abs(rows[-1] - case.record.pregrasp).max(), ROUNDING),
        at_most("approach: collision", case.scene.first_contact(rows), 0.0, "m"),
        *_table_checks(case, phase),
        # rad that a set-point may stand out of its neighbours' plane
        at_most("approach: bend", found, 2.5e-3, "rad"),
        same("approach: bend", abs(found - phase.measure), 1e-8, "rad"),
    ]  # fmt: skip


def lift_checks(case: Case) -> list[Check]:
    """Check the way straight up from the squeeze."""
    script = case.record.script
    if script is None:
        return [flag("lift given", False, "in the file")]
    phase = script.phases[1]
    rows, fingers = phase.setpoints, slice(case.robot.arm_dof, None)
    palms = np.array(list(map(case.scene.palm, rows)))
    strayed = stray(palms[:, :3, 3], palms[:, :3, :3])
    rise = palms[:, 2, 3] - palms[0, 2, 3]
    return [
        *phase_checks(phase, case.robot),
        same("lift starts at the squeeze", np.abs(rows[0] - case.record.squeeze).max(), ROUNDING),
        same("lift: fingers still", np.abs(rows[:, fingers] - rows[0, fingers]).max(), ROUNDING, "rad"),
        # m that the lift may miss its height by
        same("lift: height", abs(rise[-1] - script.lift_height), 5e-4, "m"),
        at_least("lift: rises", np.diff(rise).min(), 0.0, "m", 1e-5),
        at_most("lift: stray", strayed, 0.01, "m"),  # m that the palm may stray on the way up
        same("lift: stray", abs(strayed - phase.measure), 2e-6, "m"),
        # rad that a set-point of the lift may lie from its neighbours' cubic
        at_most("lift: jerk", jerkiness(rows), 4e-3, "rad"),
        at_most("lift: collision", case.scene.first_contact(rows, with_object=False), 0.0, "m"),
        *_table_checks(case, phase),
        *carried_checks(case, "lift", rows),
    ]  # fmt: skip


def _table_checks(case: Case, phase: Phase) -> list[Check]:
    """Check a way against the points that were seen of the table and around, where some were."""
    if case.cell.table is None:
        return []
    found = case.scene.over_seen(phase.setpoints)
    return [at_least(f"{phase.name}: clearance hand_seen", found, 0.0, "m")]


def carried_checks(case: Case, phase: str, rows: Array) -> list[Check]:
    """Check that the object goes no farther into its neighbours than it seems to lie in them."""
    if not case.scene.neighbours:
        return []
    lying, nearest = case.scene.carried(rows)
    # m: hulls of a cloud may touch, and are not the objects
    return [at_least(f"{phase}: object from its neighbours", nearest, min(lying, 0.0) - 0.002, "m")]


def phase_checks(phase: Phase, robot: Robot) -> list[Check]:
    """Check times, and the limits of position, velocity and acceleration, from rest to rest."""
    name, rows, expected = phase.name, phase.setpoints, np.arange(len(phase.times)) * CONTROL_PERIOD
    room = np.minimum(rows - robot.lower, robot.upper - rows)
    speed, change = limit_shares(rows, CONTROL_PERIOD, robot.velocity, robot.acceleration)
    return [
        same(f"{name}: times", np.abs(phase.times - expected).max(), ROUNDING, "s"),
        at_least(f"{name}: joint limits", room.min(), 0.0, "rad", ROUNDING),
        at_most(f"{name}: velocity over its limit", speed, 1.0, "", ROUNDING),
        at_most(f"{name}: acceleration over its limit", change, 1.0, "", ROUNDING),
    ]  # fmt: skip
