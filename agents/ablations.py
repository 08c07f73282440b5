"""The ablations of the paper's Table 1: the CVAE with less than the bilevel optimisation behind it (section 3.3).

Latents are tried as they are drawn, each from the palm that was decoded with it and from six palms above the object, up
to 100 of them. What is rejected differs: see the agents.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import ClassVar

from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.geometry.request import ANYHOW, GraspRequest
from dexgrasp.grasp.grasp import Grasp
from dexgrasp.mechanics.closure import TOLERANCE
from dexgrasp.mechanics.wrench import solve_wrench_qp
from dexgrasp.planning.certifier import OPENINGS, Candidate, NoGrasp, grasp_motion, opened, pressed
from dexgrasp.planning.constraints import fixed_rows
from dexgrasp.planning.cvae_source import CvaeProposals
from dexgrasp.planning.planner import Planner
from dexgrasp.planning.postures import Posture, oriented_postures, posture_at
from dexgrasp.planning.proposals import Proposals
from dexgrasp.planning.settings import GraspProblem, PlannerSettings
from dexgrasp.planning.sqp import Solution
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.cell import Cell

NO_IK, COLLISION, NO_CLOSURE, TOO_WEAK = "ik_not_converged", "collision", "eq4_infeasible", "dynamics"


class LatentAgent(BilevelAgent):
    """Base of the ablations: less of the planner behind the CVAE, no second grasp, no turn in the air."""

    planner: ClassVar[type["LatentPlanner"]]

    def __init__(
        self,
        settings: PlannerSettings | None = None,
        cell: Cell | None = None,
        *,
        request: GraspRequest = ANYHOW,
    ) -> None:
        """Prepare.

        Args:
            settings: of the planner.
            cell: as for `BilevelAgent`.
            request: mass, friction, least probability and number of the grasps; nothing of the grasp itself.

        Raises:
            InputError: without the shipped weights, or for a request of more.
        """
        if asked := request.constrains:
            raise InputError(
                f"{', '.join(asked)} are of agent bilevel: this one has no optimiser to meet them"
            )
        super().__init__("cvae", settings, cell, regrasps=0, turns=False, request=request)

    def _make(self, cell: Cell) -> Planner:
        return self.planner(self.settings, cell).asking(self._request)


class LatentPlanner(Planner):
    """Tries latents one after the other and carries out the first that nothing rejects."""

    def __init__(self, settings: PlannerSettings, cell: Cell) -> None:
        """Prepare; bounds and ranking of the search in `settings` do not count."""
        # 100 latents at most, of those that decode to three tips above the table and apart from each other.
        plain = replace(settings, triples=100, candidates=1, firm_load=-1.0, patience=0)
        super().__init__(plain, CvaeProposals(ranked=False), cell, with_closure=False)

    def starts(self, proposals: Proposals, problem: GraspProblem) -> Iterator[Posture]:
        """Yield what IK finds for each latent, in the order drawn: from its own palm, then from those above."""
        assert proposals.palms is not None  # latents have them
        goals = proposals.contacts + problem.settings.tip_height * proposals.normals
        for palm, tips in zip(proposals.palms, goals, strict=True):
            if found := posture_at(palm[:3, :3].copy(), palm[:3, 3].copy(), tips, problem):
                yield found
            yield from oriented_postures(tips, problem)


class KinematicPlanner(LatentPlanner):
    """Kinematics by the optimiser, dynamics by rejection."""

    def certify(self, candidate: Candidate) -> Grasp:
        """Return the grasp; `NoGrasp` says that its forces do not bear all of the assumed weight, or what it lacks."""
        if not candidate.hold.holds:
            raise NoGrasp(TOO_WEAK, 1.0 - candidate.hold.share)
        return super().certify(candidate)


class CvaeKinematicsAgent(LatentAgent):
    """Agent `cvae_kinematics`: latents made kinematically feasible by the optimiser until one bears the weight.

    Force closure is not part of the optimisation: what does not bear the assumed weight within friction cones and
    torque limits is rejected, and the next latent tried.
    """

    planner = KinematicPlanner


class RawPlanner(LatentPlanner):
    """Takes latents as IK reaches them; nothing is refined."""

    def __init__(self, settings: PlannerSettings, cell: Cell) -> None:
        """Prepare."""
        super().__init__(replace(settings, iterations=0), cell)

    def refine(self, start: Posture) -> Solution:
        """Return the posture as it is, and what rejects it."""
        solution = super().refine(start)
        blocking = self._blocking(start, solution)
        return replace(solution, blocking=blocking)

    def _blocking(self, start: Posture, solution: Solution) -> str | None:
        at, settings = solution.evaluation, self.settings
        if -start.score > 2e-3:  # m: the original's inverse kinematics converge to 1 to 2 mm
            return NO_IK
        if (at.values[fixed_rows(len(at.contacts))[-1] :] + settings.clearance < 0.0).any():
            return COLLISION
        balanced = solve_wrench_qp(at.contacts, at.normals, settings.friction).residual < TOLERANCE
        return None if balanced else NO_CLOSURE

    def certify(self, candidate: Candidate) -> Grasp:
        """Return the grasp, pressed with balanced forces of Eq. 4; its certificate tells what is true of them."""
        problem, q, at = candidate.start.problem, candidate.solution.q, candidate.solution.evaluation
        # Each tip presses with 4 N at least: nobody has checked what it takes to hold.
        forces = solve_wrench_qp(at.contacts, at.normals, problem.settings.friction, f_min=4.0).forces
        pregrasp = opened(q, at.normals, problem, OPENINGS[0])
        return pressed(candidate, forces, grasp_motion(q, at.normals, forces, problem, pregrasp))


class CvaeAgent(LatentAgent):
    """Agent `cvae`: the first latent that IK reaches, free of collision and feasible in Eq. 4, as it is.

    No margin, no weight, no torque limits, no refinement; the approach must exist, as nothing can be carried out
    without. It presses with balanced forces of Eq. 4.
    """

    planner = RawPlanner
