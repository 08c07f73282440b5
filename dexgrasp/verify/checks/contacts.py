"""Contacts: where the tips touch, which way they face, and how far the joints are from their limits."""

import numpy as np

from dexgrasp.grasp.record import GraspRecord
from dexgrasp.verify.checks.check import LENGTH, ROUNDING, Check, at_least, at_most, claim
from dexgrasp.verify.checks.scene import Touch
from dexgrasp_env.robot.limits import LOWER, UPPER
from dexgrasp_env.robot.names import GRASP_FINGERS

GRASPING = np.r_[0:15, 19:23]
"""Joints of the arm and of the grasping fingers."""
RING = np.r_[15:19]
_NORMAL = 1e-5  # of unit vectors
_COSINE = 2e-4  # what the optimiser leaves of an angle


def contact_checks(record: GraspRecord, touch: Touch) -> list[Check]:
    """Check depth, contacts, normals, height and the tips' directions."""
    limits = record.thresholds
    low, high = limits.distance
    depth = touch.distance - limits.tip_radius
    inward = -touch.normals
    off = float(np.abs(touch.points - record.arrays["contacts"]).max())
    turned = float(np.abs(touch.normals - record.arrays["normals"]).max())
    return [
        *(
            Check(
                f"distance:{finger}", 100.0 * float(d), f"[{100 * low:.2f}, {100 * high:.2f}] cm",
                bool(low - LENGTH <= d <= high + LENGTH),
            )
            for finger, d in zip(GRASP_FINGERS, depth, strict=True)
        ),
        at_most("contacts as claimed", off, LENGTH, "m"),
        at_most("normals as claimed", turned, _NORMAL),
        *claim(record, "distances_cm", 100.0 * depth, 100.0 * LENGTH, unit="cm"),
        at_least("contact height", float(touch.points[:, 2].min()), limits.contact_height, "m", LENGTH),
        at_least("tip cosine", float((touch.axes * inward).sum(1).min()), limits.tip_cosine, "", _COSINE),
        at_least("pad cosine", float((touch.pads * inward).sum(1).min()), limits.pad_cosine, "", _COSINE),
    ]  # fmt: skip


def limit_checks(record: GraspRecord) -> list[Check]:
    """Check the joint range of every configuration, and the margin of the grasp."""
    q = record.arrays["q"]
    margin = np.minimum(q - LOWER, UPPER - q)
    checks = [
        at_least("joint margin", float(margin[GRASPING].min()), record.thresholds.joint_margin, "rad", 1e-6)
    ]
    for name in ("q", "pregrasp", "grasp", "squeeze"):
        if name in record.arrays:
            values = record.arrays[name]
            least = float(np.minimum(values - LOWER, UPPER - values).min())
            checks.append(at_least(f"joint limits:{name}", least, 0.0, "rad", ROUNDING))
    return [*checks, *claim(record, "joint_limit_margin_rad", float(margin.min()), ROUNDING, unit="rad")]
