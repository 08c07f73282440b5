"""A feasible configuration made a grasp: forces that hold, an opening to close from, and the certificate."""

from dataclasses import replace
from itertools import product
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from dexgrasp.grasp.grasp import Grasp, GraspMotion
from dexgrasp.kinematics.forward import fingertips
from dexgrasp.kinematics.tree import robot_tree
from dexgrasp.physics.strength import capacity_of
from dexgrasp.planning.claims import certificate_of, contacts_of, is_clear
from dexgrasp.planning.holding import UNBALANCED, Hold
from dexgrasp.planning.postures import Posture
from dexgrasp.planning.result import SearchLog
from dexgrasp.planning.setpoints import OPENINGS, RISES, first_motion
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.planning.sqp import Solution
from dexgrasp.shape.target import GraspTarget
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.cell import Cell

_TIPS_MEET = (
    2.5e-4  # m that closed tips may be from the surface: a finger may end before; `verify` allows 3e-4
)
_OPEN_CLEARANCE = 0.004  # m between the open hand and the object, table and itself


Start = TypeVar("Start", bound=Posture)


class Candidate(NamedTuple, Generic[Start]):
    """A feasible configuration, where it was started from, and its squeeze."""

    start: Start
    solution: Solution
    hold: Hold


class Certifier:
    """Certifies configurations of one robot."""

    def __init__(self, cell: Cell, settings: PlannerSettings, with_closure: bool) -> None:
        """Prepare; without closure, forces that fail to hold are reported in the certificate, not refused."""
        self.cell, self.tree, self.settings = cell, robot_tree(cell), settings
        self._with_closure = with_closure

    def certify(self, candidate: Candidate[Posture], log: SearchLog) -> Grasp | None:
        """Return the grasp of a feasible configuration and its squeeze, or None and note in `log` what it lacks."""
        start, solution, hold = candidate
        settings, at, target = self.settings, solution.evaluation, start.target
        if self._with_closure and at.contacts[:, 2].min() < settings.contact_height:
            log.block("contact_height", settings.contact_height - float(at.contacts[:, 2].min()))
            return None
        if hold.share == 0.0 and self._with_closure:
            log.block(f"holding_forces: {UNBALANCED}", 1.0)
            return None
        # Firm grasps are many. One that is not is worth another way to open.
        rises = RISES[:1] if hold.merit >= settings.firm_load else RISES
        motion = self._open(solution.q, at.normals, hold.forces, target, rises)
        if motion is None:
            log.block("pregrasp_clearance")
            return None
        missed = fingertips(motion.grasp, self.tree) - (at.contacts + settings.tip_radius * at.normals)
        if (farthest := float(np.linalg.norm(missed, axis=1).max())) > _TIPS_MEET:
            log.block("surface_out_of_reach", farthest)
            return None
        certificate = certificate_of(
            solution.q, hold.forces, target, self.tree, self.settings, with_capacity=False
        )
        return Grasp(solution.q, at.contacts, at.normals, hold.forces, certificate, motion, self.cell)

    def complete(self, grasp: Grasp, target: GraspTarget) -> Grasp:
        """Return a grasp that was chosen with what is not worth computing for those that are not."""
        contacts, _ = contacts_of(grasp.q, target, self.tree, self.settings.friction_hold)
        certificate = replace(grasp.certificate, capacity=capacity_of(contacts))
        return replace(grasp, certificate=certificate)

    def _open(
        self, q: Array, normals: Array, forces: Array, target: GraspTarget, rises: tuple[float, ...]
    ) -> GraspMotion | None:
        def clear(pregrasp: Array) -> bool:
            return is_clear(pregrasp, target, self.tree, _OPEN_CLEARANCE)

        ways = product(rises, OPENINGS)
        return first_motion(q, normals, forces, target, self.tree, self.settings, ways, clear)
