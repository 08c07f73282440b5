"""A grasp checked again by another way, so that a wrong planner cannot certify itself.

The planner uses its own kinematics, its own distance to convex hulls, covering spheres and closed forms. Here: MuJoCo's
kinematics, exact distances to the mesh by closest triangles, MuJoCo's distances between the true collision shapes,
cone and quadratic programmes. `checks` has one file a subject; `docs/grasp-file.md` says what each field is held to.
"""

from collections.abc import Collection

from dexgrasp.grasp.record import GraspRecord
from dexgrasp.verify.checks.check import Check
from dexgrasp.verify.checks.clearance import clearance_checks, pregrasp_checks
from dexgrasp.verify.checks.contacts import contact_checks, limit_checks
from dexgrasp.verify.checks.conventions import convention_checks, threshold_check
from dexgrasp.verify.checks.forces import closure_checks, force_checks, strength_checks
from dexgrasp.verify.checks.identity import identity_checks
from dexgrasp.verify.checks.motion import approach_checks, lift_checks, setpoint_checks
from dexgrasp.verify.checks.scene import Scene
from dexgrasp_env.robot.active import of_process
from dexgrasp_env.robot.cell import Cell

__all__ = ["PARTS", "UNEXECUTED", "Check", "verify"]

PARTS = (
    "conventions", "object", "contacts", "limits", "clearance", "closure", "forces", "strength", "setpoints",
    "pregrasp", "approach", "lift",
)  # fmt: skip
"""Parts of the judgement, all of which a good file passes."""
UNEXECUTED = tuple(part for part in PARTS if part not in ("conventions", "approach", "lift"))
"""What can be checked of a grasp that was planned without a way to it."""


def verify(
    record: GraspRecord, parts: Collection[str] | None = None, cell: Cell | None = None
) -> list[Check]:
    """Compute every claim of a grasp again, from its joint positions, forces, hull and object alone.

    Args:
        record: of the file.
        parts: of the judgement, from `PARTS`; all by default.
        cell: in which it is to be carried out; the process's unless one is given.

    Returns:
        All checks; the grasp is good only if every one of them holds.
    """
    cell = (of_process(None) if cell is None else cell).mounted(record.grasp.mount)
    scene = Scene(cell, record.parts, record.grasp.fingers)
    touch = scene.touch(record.grasp.q)
    ways = {
        "conventions": lambda: convention_checks(record, cell),
        "thresholds": lambda: [threshold_check(record)],
        "object": lambda: identity_checks(record, scene),
        "contacts": lambda: contact_checks(record, touch),
        "limits": lambda: limit_checks(record, cell.robot),
        "clearance": lambda: clearance_checks(record, scene),
        "closure": lambda: closure_checks(record, touch),
        "forces": lambda: force_checks(record, scene, touch),
        "strength": lambda: strength_checks(record, scene, touch),
        "setpoints": lambda: setpoint_checks(record, scene, touch),
        "pregrasp": lambda: pregrasp_checks(record, scene),
        "approach": lambda: approach_checks(record, scene),
        "lift": lambda: lift_checks(record, scene),
    }
    return [check for part in (PARTS if parts is None else parts) for check in ways[part]()]
