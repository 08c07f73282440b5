"""Checks of conventions: names, units, orders and thresholds as every reader of a file takes them."""

import numpy as np

from dexgrasp.grasp.probability import probability_of
from dexgrasp.grasp.record import conventions
from dexgrasp.grasp.thresholds import FRICTION_SHARE, HOLD_SHARE, Thresholds, frozen_for
from dexgrasp.grasp.verify.case import Case
from dexgrasp.grasp.verify.check import ROUNDING, Check, flag, same
from dexgrasp_env.robot.table import SeenTable


def convention_checks(case: Case) -> list[Check]:
    """Check the stated conventions, the thresholds, and that nothing is stated that is not looked at."""
    record = case.record
    return [
        *(flag(name, getattr(record, name) == stated) for name, stated in conventions(case.cell).items()),
        *threshold_checks(case),
        *_exact_thresholds(case.limits, frozen_for(case.robot.hand)),
        _probability(case),
        *_table_checks(record.table),
    ]


def _table_checks(table: SeenTable | None) -> list[Check]:
    """Check the plane of a table that was seen: as its points have it, the lowest that none of them is above."""
    if table is None:
        return []
    normal = np.linalg.svd(table.points - table.points.mean(0))[2][2]
    normal = normal * np.sign(normal @ table.normal)
    return [
        same("normal of the table as seen", np.abs(normal - table.normal).max(), ROUNDING),
        same("offset of the table as seen", abs((table.points @ normal).max() - table.offset), ROUNDING, "m"),
    ]


def _probability(case: Case) -> Check:
    """Check that the stated probability, if any, is the shipped model's for this file."""
    stated = case.record.holds_probability
    said = None if stated is None else probability_of(case.record, stated.guessed)
    return flag("holds_probability as the model says", stated is None or stated == said)


def threshold_checks(case: Case) -> list[Check]:
    """Check that the file's thresholds are no looser than the frozen ones: no grasp moves the bar it is held to."""
    looser = case.limits.looser(case.robot.hand)
    return [Check("thresholds looser than ours", float(len(looser)), ", ".join(looser) or "none", not looser)]


def _exact_thresholds(stated: Thresholds, frozen: Thresholds) -> list[Check]:
    """Check that all but friction are the frozen ones to the letter, and both coefficients of one surface."""
    others = [
        name
        for name, value in vars(frozen).items()
        if name not in ("friction", "friction_hold") and getattr(stated, name) != value
    ]
    of_one = abs(stated.friction / FRICTION_SHARE - stated.friction_hold / HOLD_SHARE) < ROUNDING
    return [
        Check("thresholds as frozen", float(len(others)), ", ".join(others) or "none others", not others),
        flag("friction and friction_hold of one surface", of_one),
    ]
