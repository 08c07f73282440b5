"""A feasible configuration made a grasp: forces that hold, an opening to close from, and the certificate."""

from dataclasses import replace
from itertools import product
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from dexgrasp.grasp.grasp import Grasp
from dexgrasp.kinematics.forward import fingertips
from dexgrasp.physics.strength import capacity_of
from dexgrasp.planning.claims import certificate_of, contacts_of, is_clear
from dexgrasp.planning.holding import UNBALANCED, Hold
from dexgrasp.planning.postures import Posture
from dexgrasp.planning.problem import Problem
from dexgrasp.planning.result import SearchLog
from dexgrasp.planning.setpoints import OPENINGS, RISES, grasp_motion, opened
from dexgrasp.planning.sqp import Solution

_TIPS_MEET = (
    2.5e-4  # m that closed tips may be from the surface, as fingers may end before; `verify` allows 3e-4
)
_OPEN_CLEARANCE = 0.004  # m between the open hand and the object, table and itself


Start = TypeVar("Start", bound=Posture)


class Candidate(NamedTuple, Generic[Start]):
    """A feasible configuration, where it was started from, and its squeeze."""

    start: Start
    solution: Solution
    hold: Hold


class Certifier:
    """Certifies configurations."""

    def __init__(self, with_closure: bool) -> None:
        """Prepare; without closure, forces that fail to hold are reported in the certificate, not refused."""
        self._with_closure = with_closure

    def certify(self, candidate: Candidate[Posture], log: SearchLog) -> Grasp | None:
        """Return the grasp of a feasible configuration and its squeeze, or None and note in `log` what it lacks."""
        problem, hold = candidate.start.problem, candidate.hold
        settings, q, at = problem.settings, candidate.solution.q, candidate.solution.evaluation
        if self._with_closure and at.contacts[:, 2].min() < settings.contact_height:
            log.block("contact_height", settings.contact_height - float(at.contacts[:, 2].min()))
            return None
        if hold.share == 0.0 and self._with_closure:
            log.block(f"holding_forces: {UNBALANCED}", 1.0)
            return None
        # Firm grasps are many. One that is not is worth another way to open.
        rises = RISES[:1] if hold.merit >= settings.firm_load else RISES
        ways = (opened(q, at.normals, problem, opening, rise) for rise, opening in product(rises, OPENINGS))
        pregrasp = next((way for way in ways if is_clear(way, problem, _OPEN_CLEARANCE)), None)
        if pregrasp is None:
            log.block("pregrasp_clearance")
            return None
        motion = grasp_motion(q, at.normals, hold.forces, problem, pregrasp)
        missed = fingertips(motion.grasp, problem.tree) - (at.contacts + settings.tip_radius * at.normals)
        if (farthest := float(np.linalg.norm(missed, axis=1).max())) > _TIPS_MEET:
            log.block("surface_out_of_reach", farthest)
            return None
        certificate = certificate_of(q, hold.forces, problem, with_capacity=False)
        return Grasp(q, at.contacts, at.normals, hold.forces, certificate, motion, problem.cell)


def completed(grasp: Grasp, problem: Problem) -> Grasp:
    """Return a grasp that was chosen with what is not worth computing for those that are not."""
    contacts, _ = contacts_of(grasp.q, problem, problem.settings.friction_hold)
    certificate = replace(grasp.certificate, capacity=capacity_of(contacts))
    return replace(grasp, certificate=certificate)
