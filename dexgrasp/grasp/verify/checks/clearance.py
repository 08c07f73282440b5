"""Checks of clearances, by the true collision shapes: no claim may exceed them."""

import numpy as np

from dexgrasp.grasp.verify.case import Case
from dexgrasp.grasp.verify.check import Check, at_least, at_most

_TRUE = 2e-5  # m: what two ways to compute a distance of shapes may differ by


def clearance_checks(case: Case) -> list[Check]:
    """Check the grasp's clearances, tips apart, and that no more is claimed of object, table and the robot itself."""
    limits, found = case.limits, case.scene.clearances(case.record.q, tips_touch=True)
    bounds = {"hand_table": limits.off_table(case.top), "hand_seen": 0.0}
    checks = [
        at_least(f"clearance {kind}", value, bounds.get(kind, limits.clearance), "m", _TRUE)
        for kind, value in found.items()
    ]
    claimed = case.record.certificate.min_clearance_m
    counted = [
        found[kind]
        for kind in ("hand_object", "hand_table", "self")
        # m: links that the joint ranges keep this far apart do not count in the claim
        if kind != "self" or found[kind] < 0.003
    ]
    if not np.isnan(claimed):
        checks.append(at_most("min_clearance_m over the true one", claimed - min(counted), 0.0, "m", _TRUE))
    return checks


def pregrasp_checks(case: Case) -> list[Check]:
    """Check that the open hand, tips included, is clear; beside a low object it may stand as low as it grasps."""
    found, limits = case.scene.clearances(case.record.pregrasp, tips_touch=False), case.limits
    opened = 0.004  # m between the open hand and the object, the table
    bounds = {
        "hand_object": opened,
        "hand_table": limits.off_table(case.top) if limits.is_low(case.top) else opened,
        "self": 0.0,
        "hand_neighbour": 0.001,
        "hand_seen": 0.0,
    }
    return [
        at_least(f"pregrasp clearance {kind}", value, bounds[kind], "m", _TRUE)
        for kind, value in found.items()
    ]
