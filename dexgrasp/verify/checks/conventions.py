"""Names, units, orders and thresholds: what a file must state in the words that everybody reads it by."""

import re
from dataclasses import fields

from dexgrasp.grasp.record import CONVENTIONS, GraspRecord
from dexgrasp.grasp.thresholds import FRICTION_SHARE, FROZEN, HOLD_SHARE, Thresholds
from dexgrasp.verify.checks.check import ROUNDING, Check

_AGENT = re.compile(r"[A-Za-z]\w*|[\w.]+:\w+|.+\.zip")
"""A registered name, `package.module:Class`, or a checkpoint's path."""
_OF_FRICTION = ("friction", "friction_hold")


def convention_checks(record: GraspRecord) -> list[Check]:
    """Check the stated conventions, the thresholds, and the agent's name."""
    stated = record.conventions or {}
    return [
        *(_flag(name, stated.get(name) == expected) for name, expected in CONVENTIONS.items()),
        threshold_check(record),
        *_exact_thresholds(record.thresholds),
        _flag("agent", _AGENT.fullmatch(record.agent) is not None),
    ]


def threshold_check(record: GraspRecord) -> Check:
    """The file's own thresholds must be no looser than the frozen ones: a grasp cannot move the bar it is held to."""
    looser = record.thresholds.looser()
    return Check("thresholds looser than ours", float(len(looser)), ", ".join(looser) or "none", not looser)


def _exact_thresholds(stated: Thresholds) -> list[Check]:
    """All but friction are the frozen ones to the letter, and both coefficients are of one surface."""
    others = [
        f.name
        for f in fields(Thresholds)
        if f.name not in _OF_FRICTION and getattr(stated, f.name) != getattr(FROZEN, f.name)
    ]
    of_one = abs(stated.friction / FRICTION_SHARE - stated.friction_hold / HOLD_SHARE) < ROUNDING
    return [
        Check("thresholds as frozen", float(len(others)), ", ".join(others) or "none others", not others),
        _flag("friction and friction_hold of one surface", of_one),
    ]


def _flag(name: str, good: bool) -> Check:
    return Check(name, float(not good), "as documented", good)
