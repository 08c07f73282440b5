"""From an object to a certified grasp: proposals, postures, bilevel optimisation, certificate, approach."""

from collections.abc import Callable, Iterator
from itertools import islice, product
from typing import ClassVar, NamedTuple

import numpy as np

from dexgrasp.grasp.grasp import Grasp
from dexgrasp.kinematics.tree import RobotTree, robot_tree
from dexgrasp.motion.motion import NoPath
from dexgrasp.motion.script import make_script
from dexgrasp.motion.soundness import check_way
from dexgrasp.planning.certifier import Certifier
from dexgrasp.planning.holding import Hold, firmest_hold
from dexgrasp.planning.plan import Clock, Plan
from dexgrasp.planning.postures import Posture, atlas_postures, oriented_postures
from dexgrasp.planning.proposals import Proposals, ProposalSource, SurfaceProposals
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.planning.sqp import Solution, solve
from dexgrasp.shape.target import GraspTarget
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.limits import HOME

__all__ = ["Plan", "Planner", "warm_up"]

NO_POSTURE, BUDGET = "no_reachable_posture", "time_budget"


class Candidate(NamedTuple):
    """A feasible configuration and its squeeze."""

    solution: Solution
    hold: Hold


def _holds(hold: Hold) -> bool:
    return hold.holds


class Planner:
    """A planner of one robot; its proposals come from any source.

    Attributes:
        patience: rounds more, looked at whole, where there are grasps and none bears the assumed weight.
    """

    patience: ClassVar[int] = 4

    def __init__(
        self, settings: PlannerSettings | None = None, source: ProposalSource | None = None,
        mount: str = "palm_normal", *, starts: str = "atlas", with_closure: bool = True,
    ) -> None:  # fmt: skip
        """Prepare.

        Args:
            settings: thresholds and budgets.
            source: of contact triples; all triples of the surface by default.
            mount: of the hand.
            starts: `atlas` or `oriented` (section 3.3), how a proposal becomes starting postures.
            with_closure: False leaves force closure out (the ablation CVAE + kinematics).
        """
        self.settings, self.mount = settings or PlannerSettings(), mount
        self.tree: RobotTree = robot_tree(mount)
        self.source, self._starts, self._with_closure = source or SurfaceProposals(), starts, with_closure
        self.certifier = Certifier(self.tree, self.settings, mount, with_closure)

    def plan(self, target: GraspTarget, seed: int = 0, start: Array | None = None) -> Plan:
        """Return the first grasp that passes everything, with its script if `start` is given.

        Args:
            target: the object.
            seed: of the proposals.
            start: (23,) rad, set-points the robot approaches from; None plans the grasp alone.
        """
        plan, rng = Plan(), np.random.default_rng(seed)
        clock = Clock(plan)
        pool: list[Candidate] = []
        breadths = self.settings.breadths
        for k, breadth in enumerate((*breadths, *breadths[-1:] * self.patience)):
            patient = k >= len(breadths)
            if patient and (not pool or self._any(pool, _holds, target, start, plan, clock)):
                break
            if self._out_of_time(plan):
                break
            settings = self.settings.broadened(breadth)
            proposals = self.source.propose(target, settings, rng)
            plan.rounds += 1
            clock.lap("proposals")
            plan.reason = proposals.failure
            if self._firm(proposals, target, settings, start, plan, clock, pool, patient):
                return plan
        if plan.grasp is None and not self._any(pool, lambda _: True, target, start, plan, clock):
            plan.reason = plan.commonest() or plan.reason or NO_POSTURE
        return plan

    def _firm(
        self, proposals: Proposals, target: GraspTarget, settings: PlannerSettings, start: Array | None, plan: Plan,
        clock: Clock, pool: list[Candidate], patient: bool,
    ) -> bool:  # fmt: skip
        """Whether proposals gave a firm grasp that can be carried out; what is feasible but weaker goes to `pool`.

        Postures come firmest first, so that a batch without a firm one is the last that is looked at, unless `patient`.
        """
        firm = self.settings.firm_load
        solutions = self.solutions(proposals, target, settings, plan, clock)
        for batch in iter(lambda: list(islice(solutions, settings.candidates)), []):
            held = [Candidate(at, firmest_hold(at.q, target, self.tree, self.settings)) for at in batch]
            clock.lap("certificate")
            pool += held
            if self._any(pool, lambda hold: hold.merit >= firm, target, start, plan, clock):
                return True
            if not patient and max(candidate.hold.merit for candidate in held) < firm:
                return False
        return False

    def _any(
        self,
        pool: list[Candidate],
        enough: Callable[[Hold], bool],
        target: GraspTarget,
        start: Array | None,
        plan: Plan,
        clock: Clock,
    ) -> bool:
        """Whether a candidate that is good enough can be carried out; the first goes into `plan`, failures out."""
        # What holds the weight comes before what does not, though its merit with less friction may be lower.
        pool.sort(key=lambda candidate: (not candidate.hold.holds, -candidate.hold.merit))
        while pool and enough(pool[0].hold):
            solution, hold = pool.pop(0)
            grasp = self.certifier.certify(solution, hold, target, plan)
            clock.lap("certificate")
            if grasp is not None and self.carry_out(grasp, target, start, plan, clock):
                return True
        return False

    def solutions(
        self, proposals: Proposals, target: GraspTarget, settings: PlannerSettings, plan: Plan, clock: Clock
    ) -> Iterator[Solution]:
        """Yield feasible configurations until postures or time run out; note in `plan` what blocked the others."""
        for posture in clock.laps("postures", self._postures(proposals, target, settings)):
            if self._out_of_time(plan):
                return
            plan.tried += 1
            solution = self._refine(posture, target)
            clock.lap("bilevel")
            if solution.feasible:
                yield solution
            else:
                plan.block(str(solution.blocking), solution.violation)

    def _refine(self, posture: Posture, target: GraspTarget) -> Solution:
        return solve(posture.q, self.tree, target, self.settings, with_margin=self._with_closure)

    def carry_out(
        self, grasp: Grasp, target: GraspTarget, start: Array | None, plan: Plan, clock: Clock
    ) -> bool:
        """Whether the grasp can be approached; its script goes into `plan`."""
        try:
            if start is not None:
                plan.script = make_script(start, grasp.motion, target.distance, self.mount)
                check_way(plan.script, self.tree)
            plan.grasp, plan.reason = self.certifier.complete(grasp, target), None
            return True
        except NoPath as blocked:
            plan.block(blocked.reason)
            return False
        finally:
            clock.lap("approach")

    def _postures(
        self, proposals: Proposals, target: GraspTarget, settings: PlannerSettings
    ) -> Iterator[Posture]:
        if not len(proposals.contacts):
            return
        if self._starts == "atlas":
            yield from atlas_postures(proposals, target, self.tree, settings)
            return
        for k in range(len(proposals.contacts)):
            yield from oriented_postures(k, proposals, target, self.tree, settings)

    def _out_of_time(self, plan: Plan) -> bool:
        over = self.settings.seconds is not None and plan.total_seconds > self.settings.seconds
        if over:
            plan.block(BUDGET)
        return over


_WARM: set[tuple[str, type]] = set()  # mounts and kinds of source that this process has planned with


def warm_up(mount: str = "palm_normal", source: ProposalSource | None = None) -> None:
    """Load compiled code and atlas by planning for a small box, once a process: planning times are then times.

    Args:
        mount: of the hand.
        source: of the proposals, for what it needs to be loaded; all triples of the surface by default.
    """
    key = mount, type(source)
    if key in _WARM:
        return
    _WARM.add(key)
    corners = np.array(list(product((0.475, 0.525), (-0.035, 0.035), (0.0, 0.06))))
    Planner(source=source, mount=mount).plan(GraspTarget.of_corners([corners]), 0, np.array(HOME))
