"""Contacts: where the tips touch, which way they face, and how far the joints are from their limits."""

import numpy as np

from dexgrasp.grasp.record import GraspRecord
from dexgrasp.verify.checks.check import LENGTH, ROUNDING, Check, at_least, at_most, claim
from dexgrasp.verify.checks.scene import Touch
from dexgrasp_env.robot.robot import Robot

_NORMAL = 1e-5  # of unit vectors
_COSINE = 2e-4  # what the optimiser leaves of an angle


def contact_checks(record: GraspRecord, touch: Touch) -> list[Check]:
    """Check depth, contacts, normals, height and the tips' directions."""
    limits = record.thresholds
    low, high = limits.distance
    depth = touch.distance - limits.tip_radius
    inward = -touch.normals
    off = float(np.abs(touch.points - record.grasp.contacts).max())
    turned = float(np.abs(touch.normals - record.grasp.normals).max())
    return [
        *(
            Check(
                f"distance:{finger}", 100.0 * float(d), f"[{100 * low:.2f}, {100 * high:.2f}] cm",
                bool(low - LENGTH <= d <= high + LENGTH),
            )
            for finger, d in zip(record.grasp.fingers, depth, strict=True)
        ),
        at_most("contacts as claimed", off, LENGTH, "m"),
        at_most("normals as claimed", turned, _NORMAL),
        *claim(record, "distances_cm", 100.0 * depth, 100.0 * LENGTH, unit="cm"),
        at_least("contact height", float(touch.points[:, 2].min()), limits.contact_height, "m", LENGTH),
        at_least("tip cosine", float((touch.axes * inward).sum(1).min()), limits.tip_cosine, "", _COSINE),
        at_least("pad cosine", float((touch.pads * inward).sum(1).min()), limits.pad_cosine, "", _COSINE),
    ]  # fmt: skip


def limit_checks(record: GraspRecord, robot: Robot) -> list[Check]:
    """Check the joint range of every configuration, and the margin of the grasp."""
    motion = record.grasp.motion
    rows = {
        "q": record.grasp.q,
        "pregrasp": motion.pregrasp,
        "grasp": motion.grasp,
        "squeeze": motion.squeeze,
    }
    margins = {name: np.minimum(row - robot.lower, robot.upper - row) for name, row in rows.items()}
    busy, bound = np.delete(margins["q"], idle_joints(record, robot)), record.thresholds.joint_margin
    return [
        at_least("joint margin", float(busy.min()), bound, "rad", 1e-6),
        *(
            at_least(f"joint limits:{name}", float(margin.min()), 0.0, "rad", ROUNDING)
            for name, margin in margins.items()
        ),
        *claim(record, "joint_limit_margin_rad", float(margins["q"].min()), ROUNDING, unit="rad"),
    ]


def idle_joints(record: GraspRecord, robot: Robot) -> list[int]:
    """Return the joints of the fingers that make no contact."""
    idle = [columns for finger, columns in robot.columns.items() if finger not in record.grasp.fingers]
    return [joint for columns in idle for joint in range(columns.start, columns.stop)]
