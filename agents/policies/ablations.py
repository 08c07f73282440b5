"""The ablations of the paper that run the CVAE with less than the bilevel optimisation behind it."""

from dataclasses import replace

from agents.grasp.grasp import Grasp
from agents.grasp.target import GraspTarget
from agents.learning.cvae_source import CvaeProposals
from agents.planning.certifier import Certifier
from agents.planning.claims import certificate_of
from agents.planning.holding import Hold
from agents.planning.plan import Plan
from agents.planning.planner import Planner
from agents.planning.postures import Posture
from agents.planning.proposals import ProposalSource
from agents.planning.setpoints import OPENINGS, grasp_motion
from agents.planning.settings import PlannerSettings
from agents.planning.sqp import Solution
from agents.policies.bilevel import BilevelAgent

MISS = 2e-3
"""m, of the worst fingertip, at which IK counts as converged (facts of the original: 1 to 2 mm)."""
PRESS = 4.0
"""N that each fingertip presses with, straight in: nobody has checked what it takes to hold."""
NO_IK = "ik_not_converged"


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
            InputError: without the shipped weights.
        """
        self._learned = CvaeProposals(ranked=False)
        super().__init__("surface", settings, mount, with_closure=False, starts="oriented")

    def _make(self, mount: str) -> Planner:
        return RawPlanner(self.settings, self._learned, mount)


class CvaeKinematicsAgent(BilevelAgent):
    """Agent `cvae_kinematics`: as `bilevel` with learned proposals, but without force closure anywhere."""

    def __init__(self, settings: PlannerSettings | None = None, mount: str = "palm_normal") -> None:
        """Prepare; arguments and errors are those of `CvaeAgent`."""
        self._learned = CvaeProposals(ranked=False)
        super().__init__("surface", settings, mount, with_closure=False, starts="oriented")

    def _make(self, mount: str) -> Planner:
        return Planner(
            first_found(self.settings), self._learned, mount, starts="oriented", with_closure=False
        )


class RawPlanner(Planner):
    """Takes the first proposal that IK reaches and that can be approached, as it is."""

    def __init__(self, settings: PlannerSettings, source: ProposalSource, mount: str) -> None:
        """Prepare; `settings.postures` bounds the proposals."""
        once = replace(first_found(settings), breadths=(1.0,), triples=settings.postures, iterations=0)
        super().__init__(once, source, mount, starts="oriented", with_closure=False)
        self._certifier = UncheckedCertifier(self.tree, self.settings, mount, with_closure=False)

    def _refine(self, posture: Posture, target: GraspTarget) -> Solution:
        reached = -posture.score <= MISS
        return replace(
            super()._refine(posture, target), feasible=reached, blocking=None if reached else NO_IK
        )


class UncheckedCertifier(Certifier):
    """Presses straight in with what nobody has checked; the certificate tells what is true of that."""

    def certify(self, solution: Solution, hold: Hold, target: GraspTarget, plan: Plan) -> Grasp | None:
        """Return the grasp, whatever it is worth."""
        q, at = solution.q, solution.evaluation
        forces = -PRESS * at.normals
        motion = grasp_motion(q, at.normals, forces, target, self.tree, self.settings, OPENINGS[0])
        certificate = certificate_of(q, forces, target, self.tree, self.settings, with_capacity=False)
        return Grasp(q, at.contacts, at.normals, forces, certificate, motion, self.mount)


def first_found(settings: PlannerSettings) -> PlannerSettings:
    """Return settings that carry out the first grasp found, however firmly it holds (section 3.3)."""
    return replace(settings, candidates=1, firm_load=0.0)
