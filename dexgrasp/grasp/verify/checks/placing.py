"""Checks of placing: the object is carried to the stated goal, set down there, and left untouched."""

from itertools import pairwise

import numpy as np

from dexgrasp.grasp.record import Phase
from dexgrasp.grasp.trajectory import bend, densify
from dexgrasp.grasp.verify.case import Case
from dexgrasp.grasp.verify.check import ROUNDING, Check, at_least, at_most, flag, same
from dexgrasp.grasp.verify.checks.motion import carried_checks, phase_checks
from dexgrasp.grasp.verify.scene import Scene
from dexgrasp_env.arrays import Array, middle
from dexgrasp_env.poses import inverse, placed

_OFF, _TURNED = 0.01, 2.0  # m and degrees that it may be set down beside its goal


def placing_checks(case: Case) -> list[Check]:
    """Check carry, setting down, release and retreat; nothing where no goal was asked for."""
    record, hand = case.record, slice(case.robot.arm_dof, None)
    if record.goal is None:
        return []
    if record.script is None:
        return [flag("placing given", False, "in the file")]
    ways = record.script.phases[1:]
    lift, *held, release, retreat = (phase.setpoints for phase in ways)
    carried = np.concatenate(held)
    gaps = [one.setpoints[-1] - other.setpoints[0] for one, other in pairwise(ways)]
    T = case.scene.palm(carried[-1]) @ inverse(case.scene.palm(lift[0]))
    there = Scene(
        case.cell, [placed(T, part) for part in record.parts], record.fingers, record.neighbour_parts
    )
    meets = {
        "carry": case.scene.first_contact(carried, with_object=False),
        "release": case.scene.first_contact(release, with_object=False),
        "retreat": there.first_contact(retreat),
    }
    return [
        *(check for phase in ways[1:] for check in [*phase_checks(phase, case.robot), _bend(phase)]),
        same("placing: one phase begins where the last ends", np.abs(gaps).max(), ROUNDING, "rad"),
        same("carry: fingers still", np.abs(carried - record.squeeze)[:, hand].max(), ROUNDING, "rad"),
        same("release: arm still", np.abs(release - release[0])[:, : hand.start].max(), ROUNDING, "rad"),
        same("retreat: hand open", np.abs(retreat - record.pregrasp)[:, hand].max(), ROUNDING, "rad"),
        *(at_most(f"{name}: collision", depth, 0.0, "m") for name, depth in meets.items()),
        *carried_checks(case, "carry", densify(np.concatenate([lift, carried]))),
        *_goal_checks(case, T),
    ]


def _bend(phase: Phase) -> Check:
    return same(f"{phase.name}: bend", abs(bend(phase.setpoints) - phase.measure), 1e-8, "rad")


def _goal_checks(case: Case, T: Array) -> list[Check]:
    """Check where the planned parts, moved by `T` (4, 4), are let go of."""
    goal, corners = case.record.goal, np.concatenate(case.record.parts)
    assert goal is not None
    place, foot = placed(case.cell.T_world_base, goal.place), np.array([*middle(corners)[:2], 0.0])
    lowest, turn = placed(T, corners)[:, 2].min(), np.degrees(np.arctan2(T[1, 0], T[0, 0]))
    off = 0.0 if goal.yaw is None else (turn - goal.yaw + 180.0) % 360.0 - 180.0
    return [
        at_most("goal: off its place", np.linalg.norm((placed(T, foot) - place)[:2]), _OFF, "m"),
        at_most("goal: off its heading", abs(off), _TURNED, "degrees"),
        at_most("goal: leaning", np.degrees(np.arccos(min(T[2, 2], 1.0))), _TURNED, "degrees"),
        at_most("goal: let go above the table", lowest, 0.006, "m"),
        at_least("goal: let go above the table", lowest, 0.0, "m", 1e-3),
        at_most("goal: height of its place", abs(place[2]), _OFF, "m"),
    ]
