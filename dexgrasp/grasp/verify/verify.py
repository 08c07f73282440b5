"""A grasp checked again by another way, so that a wrong planner cannot certify itself.

The planner uses its own kinematics, its own distance to convex hulls, MuJoCo's between shapes and closed forms. Here:
MuJoCo's kinematics, exact distances to the mesh by closest triangles, distances between the true collision shapes by
quadratic programmes over their half-spaces, cone and quadratic programmes. `checks` has one file a subject;
`docs/grasp-file.md` says what each field is held to.
"""

from collections.abc import Callable, Collection

from dexgrasp.grasp.record import GraspRecord
from dexgrasp.grasp.verify.case import Case
from dexgrasp.grasp.verify.check import Check
from dexgrasp.grasp.verify.checks.clearance import clearance_checks, pregrasp_checks
from dexgrasp.grasp.verify.checks.contacts import contact_checks, limit_checks, request_checks
from dexgrasp.grasp.verify.checks.conventions import convention_checks, threshold_checks
from dexgrasp.grasp.verify.checks.forces import closure_checks, force_checks, strength_checks
from dexgrasp.grasp.verify.checks.identity import identity_checks
from dexgrasp.grasp.verify.checks.motion import approach_checks, lift_checks, setpoint_checks
from dexgrasp.grasp.verify.checks.placing import placing_checks
from dexgrasp_env.valid import checked

_CHECKS: dict[str, Callable[[Case], list[Check]]] = {
    "conventions": convention_checks,
    "object": identity_checks,
    "contacts": contact_checks,
    "request": request_checks,
    "limits": limit_checks,
    "clearance": clearance_checks,
    "closure": closure_checks,
    "forces": force_checks,
    "strength": strength_checks,
    "setpoints": setpoint_checks,
    "pregrasp": pregrasp_checks,
    "approach": approach_checks,
    "lift": lift_checks,
    "placing": placing_checks,
    "thresholds": threshold_checks,
}
PARTS = tuple(part for part in _CHECKS if part != "thresholds")
"""Parts of the judgement, all of which a good file passes; `thresholds` alone is a part of `conventions`."""
UNEXECUTED = tuple(part for part in PARTS if part not in ("conventions", "approach", "lift", "placing"))
"""What can be checked of a grasp that was planned without a way to it."""


@checked
def verify(record: GraspRecord, parts: Collection[str] = PARTS) -> list[Check]:
    """Compute every claim of a grasp again, from its joint positions, forces, hull and object alone.

    Args:
        record: of the file, read in the cell where the grasp is to be carried out.
        parts: of the judgement, from `PARTS`; all by default.

    Returns:
        All checks; the grasp is good only if every one of them holds.
    """
    case = Case(record)
    return [check for part in parts for check in _CHECKS[part](case)]
