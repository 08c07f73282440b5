"""The ablations of the paper that run the CVAE with less than the bilevel programme behind it."""

import time
from dataclasses import replace

import numpy as np

from agents.execution.motion import NoPath
from agents.execution.script import make_script
from agents.grasp.grasp import Grasp
from agents.grasp.target import GraspTarget
from agents.learning.cvae_source import CvaeProposals
from agents.planning.claims import certificate_of
from agents.planning.planner import Plan, Planner
from agents.planning.postures import oriented_postures
from agents.planning.setpoints import OPENINGS, grasp_motion
from agents.planning.settings import PlannerSettings
from agents.planning.sqp import solve
from agents.policies.bilevel import BilevelAgent
from dexgrasp_env.arrays import Array

MISS = 2e-3
"""m, of the worst fingertip, at which IK counts as converged (facts of the original: 1 to 2 mm)."""
PRESS = 4.0
"""N that each fingertip presses with, straight in: nobody has checked what it takes to hold."""
_IK, _NO_LATENT = "ik_not_converged", "no_latent_reachable"


class CvaeAgent(BilevelAgent):
    """Agent `cvae`: the first latent whose fingertips IK reaches from one of six orientations, as it is.

    No closure, no clearances, no refinement; the approach must exist, as nothing can be carried out without.
    """

    def __init__(self, settings: PlannerSettings | None = None, mount: str = "palm_normal") -> None:
        """Prepare.

        Args:
            settings: of the planner; `postures` bounds the latents.
            mount: of the hand.

        Raises:
            InputError: without torch or the shipped weights.
        """
        self._learned = CvaeProposals(ranked=False)
        super().__init__("surface", settings, mount, with_closure=False, starts="oriented")

    def _make(self, mount: str) -> Planner:
        return RawPlanner(self.settings, self._learned, mount, starts="oriented", with_closure=False)


class CvaeKinematicsAgent(BilevelAgent):
    """Agent `cvae_kinematics`: as `bilevel` with learned proposals, but without wrench closure anywhere."""

    def __init__(self, settings: PlannerSettings | None = None, mount: str = "palm_normal") -> None:
        """Prepare; arguments and errors are those of `CvaeAgent`."""
        self._learned = CvaeProposals(ranked=False)
        super().__init__("surface", settings, mount, with_closure=False, starts="oriented")

    def _make(self, mount: str) -> Planner:
        # The first feasible grasp (section 3.3): how firmly it holds is not asked.
        first = replace(self.settings, candidates=1, firm_load=0.0)
        return Planner(first, self._learned, mount, starts="oriented", with_closure=False)


class RawPlanner(Planner):
    """Executes a proposal through IK alone."""

    def plan(self, target: GraspTarget, seed: int = 0, start: Array | None = None) -> Plan:
        """Return the first proposal that IK reaches and that can be approached; see `Planner.plan`."""
        plan, began = Plan(), time.perf_counter()
        proposals = self._source.propose(target, self.settings, np.random.default_rng(seed))
        plan.seconds["proposals"] = time.perf_counter() - began
        plan.reason = proposals.failure
        for k in range(min(len(proposals.contacts), self.settings.postures)):
            if self._late(plan):
                break
            began = time.perf_counter()
            self._try(
                k, oriented_postures(k, proposals, target, self.tree, self.settings), target, plan, start
            )
            plan.seconds["postures"] = plan.seconds.get("postures", 0.0) + time.perf_counter() - began
            if plan.grasp is not None:
                plan.reason = None
                return plan
        plan.reason = plan.reason or (
            max(plan.blocked, key=lambda r: plan.blocked[r][0]) if plan.blocked else _NO_LATENT
        )
        return plan

    def _late(self, plan: Plan) -> bool:
        return self.settings.seconds is not None and plan.total_seconds > self.settings.seconds

    def _try(self, k: int, postures: list, target: GraspTarget, plan: Plan, start: Array | None) -> None:
        for posture in postures:
            plan.tried += 1
            if -posture.score > MISS:
                _count(plan, _IK)
                continue
            grasp = self._unrefined(posture.q, target)
            try:
                plan.script = (
                    None if start is None else make_script(start, grasp.motion, target.distance, self.mount)
                )
            except NoPath as blocked:
                _count(plan, blocked.reason)
                continue
            plan.grasp = grasp
            return

    def _unrefined(self, q: Array, target: GraspTarget) -> Grasp:
        solution = solve(q, self.tree, target, replace(self.settings, iterations=0))
        normals = solution.evaluation.normals
        forces = -PRESS * normals
        motion = grasp_motion(solution.q, normals, forces, target, self.tree, self.settings, OPENINGS[0])
        certificate = certificate_of(solution.q, forces, target, self.tree, self.settings)
        return Grasp(
            solution.q, solution.evaluation.contacts, normals, forces, certificate, motion, self.mount
        )


def _count(plan: Plan, reason: str) -> None:
    plan.blocked[reason] = (plan.blocked.get(reason, (0, 0.0))[0] + 1, 0.0)
