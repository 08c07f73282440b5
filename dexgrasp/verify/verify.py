"""A grasp checked again by another way, so that a wrong planner cannot certify itself.

The planner uses its own kinematics, its own distance to convex hulls, covering spheres and closed forms. Here: MuJoCo's
kinematics, exact distances to the mesh by closest triangles, MuJoCo's distances between the true collision shapes,
cone and quadratic programmes. `checks` has one file a subject; `docs/grasp-file.md` says what each field is held to.
"""

from collections.abc import Collection

from dexgrasp.grasp.record import SCHEMA, GraspRecord
from dexgrasp.verify.checks.check import Check
from dexgrasp.verify.checks.clearance import clearance_checks, pregrasp_checks
from dexgrasp.verify.checks.contacts import contact_checks, limit_checks
from dexgrasp.verify.checks.conventions import convention_checks, threshold_check
from dexgrasp.verify.checks.forces import closure_checks, force_checks, strength_checks
from dexgrasp.verify.checks.identity import identity_checks, mass_checks
from dexgrasp.verify.checks.motion import approach_checks, lift_checks, setpoint_checks
from dexgrasp.verify.checks.scene import Scene

__all__ = ["PARTS", "PARTS_1", "UNEXECUTED", "Check", "unchecked", "verify"]

PARTS = (
    "conventions", "object", "contacts", "limits", "clearance", "closure", "forces", "strength", "setpoints",
    "pregrasp", "approach", "lift",
)  # fmt: skip
"""Parts of the judgement, all of which a good file passes."""
UNEXECUTED = tuple(part for part in PARTS if part not in ("conventions", "approach", "lift"))
"""What can be checked of a grasp that was planned without a way to it."""
PARTS_1 = ("thresholds", "contacts", "limits", "clearance", "closure", "forces", "pregrasp")
"""What can be checked of a file of schema 1."""


def verify(record: GraspRecord, parts: Collection[str] | None = None) -> list[Check]:
    """Compute every claim of a grasp again, from its joint positions, forces, hull and object alone.

    Args:
        record: of the file.
        parts: of the judgement, from `PARTS`; by default all that a file of its schema can have.

    Returns:
        All checks; the grasp is good only if every one of them holds.
    """
    scene = Scene(record)
    touch = scene.touch(record.arrays["q"])
    ways = {
        "conventions": lambda: convention_checks(record),
        "thresholds": lambda: [threshold_check(record)],
        "object": lambda: identity_checks(record, scene),
        "mass": lambda: mass_checks(record, scene),
        "contacts": lambda: contact_checks(record, touch),
        "limits": lambda: limit_checks(record),
        "clearance": lambda: clearance_checks(record, scene),
        "closure": lambda: closure_checks(record, touch),
        "forces": lambda: force_checks(record, touch),
        "strength": lambda: strength_checks(record, touch),
        "setpoints": lambda: setpoint_checks(record, scene, touch),
        "pregrasp": lambda: pregrasp_checks(record, scene),
        "approach": lambda: approach_checks(record, scene),
        "lift": lambda: lift_checks(record, scene),
    }
    wanted = (PARTS if record.schema == SCHEMA else PARTS_1) if parts is None else parts
    return [check for part in wanted for check in ways[part]()]


def unchecked(record: GraspRecord) -> list[str]:
    """Return the parts of the judgement that a file of an older schema has nothing for; none for today's."""
    return [part for part in PARTS if part not in PARTS_1] if record.schema < SCHEMA else []
