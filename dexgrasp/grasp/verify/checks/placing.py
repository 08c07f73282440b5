"""Placing: is the object carried to the goal that the file states, set down there, and left untouched."""

from itertools import pairwise

import numpy as np

from dexgrasp.grasp.record import Phase
from dexgrasp.grasp.trajectory import bend, densify
from dexgrasp.grasp.verify.case import Case
from dexgrasp.grasp.verify.check import ROUNDING, Check, at_least, at_most, flag, same
from dexgrasp.grasp.verify.checks.motion import phase_checks
from dexgrasp.grasp.verify.scene import Scene
from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import placed, rigid

DROP = 0.006  # m above the table from which an object may be let go of
_SUNK = 0.001  # m into it
_OFF, _TURNED = 0.01, 2.0  # m and degrees that it may be set down beside its goal
_DENSE = 0.01  # rad of any joint between two states checked for collisions
_SAME_BEND = 1e-8  # rad
_DEEPER = 0.002  # m: hulls of a cloud may touch, and are not the objects


def placing_checks(case: Case) -> list[Check]:
    """Check carry, setting down, release and retreat; nothing where no goal was asked for."""
    record = case.record
    if record.goal is None:
        return []
    if record.script is None or len(record.script.phases) < 6:
        return [flag("placing given", False, "in the file")]
    lift, carry, lowering, release, retreat = record.script.phases[1:]
    hand, held = slice(case.robot.arm_dof, None), np.concatenate([carry.setpoints, lowering.setpoints])
    loose = np.concatenate([release.setpoints, retreat.setpoints])
    ways = [lift, carry, lowering, release, retreat]
    gaps = [a.setpoints[-1] - b.setpoints[0] for a, b in pairwise(ways)]
    arm = release.setpoints[:, : case.robot.arm_dof]
    T = _motion(case, lift.setpoints[0], held[-1])
    there = Scene(case.cell, [placed(T, part) for part in record.parts], record.fingers, record.around)
    collision = case.scene.first_contact(densify(held, _DENSE), with_object=False)
    opening = case.scene.first_contact(densify(release.setpoints, _DENSE), with_object=False)
    leaving = there.first_contact(densify(retreat.setpoints, _DENSE))
    return [
        *(check for phase in ways[1:] for check in [*phase_checks(phase, case.robot), _bend(phase)]),
        same("placing: one phase begins where the last ends", np.abs(gaps).max(), ROUNDING, "rad"),
        same("carry: fingers still", np.abs(held[:, hand] - record.squeeze[hand]).max(), ROUNDING, "rad"),
        same("release: arm still", np.abs(arm - arm[0]).max(), ROUNDING, "rad"),
        same("release: hand as before the grasp", np.abs(loose[-1] - record.pregrasp)[hand].max(), ROUNDING, "rad"),
        at_most("carry: collision", collision, 0.0, "m"),
        at_most("release: collision", opening, 0.0, "m"),
        at_most("retreat: collision", leaving, 0.0, "m"),
        *_neighbour_checks(case, np.concatenate([lift.setpoints, held])),
        *_goal_checks(case, T),
    ]  # fmt: skip


def _bend(phase: Phase) -> Check:
    return same(f"{phase.name}: bend", abs(bend(phase.setpoints) - phase.measure), _SAME_BEND, "rad")


def _motion(case: Case, before: Array, after: Array) -> Array:
    """Return the motion (4, 4) of what the palm holds between two configurations (n,) rad."""
    (p, R), (q, S) = case.scene.palm(before), case.scene.palm(after)
    return rigid(S, q) @ np.linalg.inv(rigid(R, p))


def _neighbour_checks(case: Case, rows: Array) -> list[Check]:
    if not case.scene.around:
        return []
    lying, nearest = case.scene.carried(densify(rows, _DENSE))
    return [at_least("carry: object from its neighbours", nearest, min(lying, 0.0) - _DEEPER, "m")]


def _goal_checks(case: Case, T: Array) -> list[Check]:
    """Check where the planned parts, moved by `T` (4, 4), are let go of."""
    goal, corners = case.record.goal, np.concatenate(case.record.parts)
    assert goal is not None
    foot = np.array([*0.5 * (corners.min(0) + corners.max(0))[:2], corners[:, 2].min()])
    at, turn = placed(T, foot), np.degrees(np.arctan2(T[1, 0], T[0, 0]))
    off = at[:2] - placed(case.cell.T_world_base, goal.place)[:2]
    yaw = 0.0 if goal.yaw is None else (turn - goal.yaw + 180.0) % 360.0 - 180.0
    lowest = placed(T, corners)[:, 2].min()
    return [
        at_most("goal: off its place", np.linalg.norm(off), _OFF, "m"),
        at_most("goal: off its heading", abs(yaw), _TURNED, "degrees"),
        at_most("goal: leaning", np.degrees(np.arccos(min(T[2, 2], 1.0))), _TURNED, "degrees"),
        at_most("goal: let go above what it stands on", lowest, DROP, "m"),
        at_least("goal: let go above what it stands on", lowest, -_SUNK, "m"),
        at_most("goal: height of its place", abs(placed(case.cell.T_world_base, goal.place)[2]), _OFF, "m"),
    ]
