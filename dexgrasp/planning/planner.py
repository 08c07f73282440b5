"""From an object to a certified grasp: proposals, postures, bilevel optimisation, certificate, approach."""

import time
from collections.abc import Callable, Collection, Iterator
from copy import copy
from dataclasses import replace
from itertools import islice

import numpy as np

from dexgrasp.geometry.request import ANYHOW, GraspRequest
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.grasp import RAISED, Grasp
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.motion.collision import raised_into
from dexgrasp.motion.motion import NoPath
from dexgrasp.motion.script import check_way, make_script
from dexgrasp.planning.atlas import hand_atlas
from dexgrasp.planning.certifier import OPEN_CLEARANCE, Candidate, NoGrasp, certified, completed
from dexgrasp.planning.holding import GraspForces, firmest_forces, lightened
from dexgrasp.planning.postures import Posture, atlas_postures
from dexgrasp.planning.proposals import Proposals, ProposalSource, SurfaceProposals
from dexgrasp.planning.result import Planned, PlanResult, SearchLog
from dexgrasp.planning.set_down import OUT_OF_REACH, GoalPoses, goal_poses, reaches_goal, to_goal
from dexgrasp.planning.settings import GraspProblem, PlannerSettings
from dexgrasp.planning.sqp import Solution, solve
from dexgrasp.runs.compiling import compiling
from dexgrasp_env.arrays import Array, array, grid
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.cell import Cell, default_cell
from dexgrasp_env.robot.table import SeenTable
from dexgrasp_env.valid import Names, Natural, check, check_fields, checked, read

NO_POSTURE, BUDGET, LIFT_BLOCKED = "no_reachable_posture", "time_budget", "lift_blocked"

_BESIDE = 0.004, 0.010  # m that the approach keeps from the object; the second where it must not be hit


def _holds(hold: GraspForces) -> bool:
    return hold.holds


def _robust(hold: GraspForces) -> bool:
    return hold.robust_load >= 1.0


class Planner:
    """A planner of one robot; its proposals come from any source."""

    @checked
    def __init__(
        self, settings: PlannerSettings | None = None, source: ProposalSource | None = None,
        cell: Cell | None = None, *, with_closure: bool = True,
    ) -> None:  # fmt: skip
        """Prepare.

        Args:
            settings: thresholds and budgets.
            source: of contact triples; all triples of the surface by default.
            cell: of the robot; the simulated one by default.
            with_closure: False leaves force closure out (the ablation CVAE + kinematics).

        Raises:
            InputError: for settings that are not valid, or a source of another hand.
        """
        self.cell = cell or default_cell()
        self.settings = (settings or PlannerSettings()).for_hand(self.cell.robot.hand)
        check_fields(self.settings)
        self.tree = robot_tree(self.cell)
        if self.settings.fingers == 2:
            gap = float(hand_atlas(self.cell).search.maxes[0])  # m between the tips' centres, open
            self.settings = replace(
                self.settings, widest=gap - 2.0 * (self.settings.tip_radius + OPEN_CLEARANCE)
            )
        self.source, self._with_closure = source or SurfaceProposals(), with_closure
        self.source.check_hand(self.cell.robot.hand)
        self.request = ANYHOW

    def seeing(self, table: SeenTable | None) -> "Planner":
        """Return the planner in its cell with the table where it was seen; None: where the cell has it."""
        if table is None:
            return self
        there = copy(self)
        there.cell = self.cell.seeing(table)
        there.tree = robot_tree(there.cell)
        return there

    def asking(self, request: GraspRequest) -> "Planner":
        """Return the planner of grasps that are as a request, or a mapping of its fields, asks.

        Raises:
            InputError: for what is no request, fingers that make no grasp of the hand, or less force than they press
                with at least.
        """
        request = read(GraspRequest, request, "request")
        if not (request or self.request):
            return self
        there = copy(self._with_fingers(request.fingers) if request.fingers else self)
        there.settings, there.request = there.settings.asked(request), request
        return there

    def _with_fingers(self, names: Collection[str]) -> "Planner":
        grasps = self.cell.robot.hand.grasps or (self.cell.robot.hand.grasp,)
        found = next((fingers for fingers in grasps if set(fingers) == set(names)), None)
        if found is None:
            valid = "; ".join(" ".join(fingers) for fingers in grasps)
            raise InputError(f"the hand has no grasp with fingers {' '.join(names)}: valid are {valid}")
        return self if found == self.cell.robot.hand.grasp else self._of(found)

    def _of(self, fingers: Names) -> "Planner":
        settings = replace(self.settings, widest=PlannerSettings.widest)
        return Planner(settings, cell=self.cell.grasping(fingers))

    def others(self) -> Iterator["Planner"]:
        """Yield planners of the other grasps of the hand, whose contacts any source but the surface would not know."""
        for fingers in self.cell.robot.hand.grasps if self._with_closure else ():
            if self.cell.grasping(fingers) != self.cell:
                yield self._of(fingers)

    @checked
    def plan(self, target: GraspTarget, seed: Natural = 0, start: Array | None = None) -> PlanResult:
        """Return the first grasp that passes everything, with its script if `start` is given.

        Where it bears no weight, or there is none, the other grasps of the hand's file are tried in turn, and then the
        walls of what is hollow.

        Args:
            target: the object.
            seed: of the proposals.
            start: (n,) rad, set-points the robot approaches from; None plans the grasp alone.
        """
        result = Search(self, target, seed, start).run()
        for other, shape in self._otherwise(target):
            found = result.grasp is not None and result.grasp.certificate.holds
            if found or self.out_of_time(result.log):
                break
            again = Search(other, shape, seed, start, result.log.began).run()
            if again.grasp is not None and (result.grasp is None or again.grasp.certificate.holds):
                result = again
        return result

    def _otherwise(self, target: GraspTarget) -> Iterator[tuple["Planner", GraspTarget]]:
        """Yield who plans next, on what shape of the object, where there is no grasp that holds."""
        if not target.demand.request.fingers:
            yield from ((other, target) for other in self.others())
        if (walls := target.opened()) is not None:
            yield self, walls

    def candidates(self, starts: Iterator[Posture], log: SearchLog) -> Iterator[Candidate]:
        """Yield what is feasible of starting postures until they or the time run out; note what blocked the others."""
        for start in log.laps("postures", starts):
            if self.out_of_time(log):
                return
            log.tried += 1
            solution = self.refine(start)
            log.lap("bilevel")
            if not solution.feasible:
                log.block(str(solution.blocking), solution.violation)
                continue
            hold = firmest_forces(solution.q, start.problem)
            log.lap("certificate")
            yield Candidate(start, solution, hold)

    def starts(self, proposals: Proposals, problem: GraspProblem) -> Iterator[Posture]:
        """Yield the postures that proposals are refined from, the likeliest first."""
        return atlas_postures(proposals, problem)

    def refine(self, start: Posture) -> Solution:
        """Return where the optimiser ends from a posture."""
        return solve(start.q, start.problem, with_margin=self._with_closure)

    def certify(self, candidate: Candidate) -> Grasp:
        """Return the grasp of a candidate; `NoGrasp` says what it lacks."""
        return certified(candidate, self._with_closure)

    def out_of_time(self, log: SearchLog) -> bool:
        """Return True, and note it, once a search has taken as long as it may."""
        over = self.settings.seconds is not None and time.perf_counter() - log.began > self.settings.seconds
        if over:
            log.block(BUDGET)
        return over


class Search:
    """One search of a planner for grasps of an object.

    Attributes:
        planner: whose it is.
        result: what has been found.
        log: of the result.
        pool: what is feasible, and not yet found to lack anything.
    """

    def __init__(
        self,
        planner: Planner,
        target: GraspTarget,
        seed: int,
        start: Array | None,
        began: float | None = None,
    ) -> None:
        """Prepare; the arguments are those of `Planner.plan`, and when its time began to run (`perf_counter`).

        Raises:
            InputError: for a start that is none of the robot's.
        """
        self.planner = planner
        self._start = None if start is None else check("start", start, array(planner.cell.robot.dof))
        self._problem = GraspProblem(target, planner.cell, planner.settings)
        self._poses: GoalPoses = []
        self._rng = np.random.default_rng(seed)
        self.result = PlanResult(target, planner.settings, seed)
        self.log, self.pool = self.result.log, list[Candidate]()
        self.log.began = began or self.log.began

    def run(self) -> PlanResult:
        """Return the first firm grasp of some rounds; failing that the best of all that is feasible.

        The best grasp before a round will do if it bears the weight on slippery surfaces too; in the end, and among
        neighbours, where a firm grasp is rare, soon: if it bears the weight at all. There each round samples more, as
        few postures are clear, and there are four at most: another look, or one set aside, gives more.
        """
        result, crowded = self.result, self._problem.target.around is not None
        if self.is_hopeless():
            return result
        patience = min(self.planner.settings.patience, 3) if crowded else self.planner.settings.patience
        for k in range(patience + 1):
            last = k > 1 if crowded else k == patience
            if self.take(_holds if last else _robust) or self.planner.out_of_time(self.log):
                break
            if self._firm(breadth=min(k + 1, 3) if crowded else 1, patient=crowded or k > 0):
                break
            if OUT_OF_REACH in self.log.blocked and not self.log.tried:  # more postures reach no farther
                break
        if not result.found:
            self.pool = [one._replace(hold=lightened(one.hold, one.start.problem)) for one in self.pool]
        if result.found or self.take(lambda _: True):
            result.shortfall = None
        else:
            result.shortfall = self.log.commonest() or result.shortfall or NO_POSTURE
        return result

    def is_hopeless(self) -> bool:
        """Return True where something rules every grasp out, and note it; look for poses at a goal before that."""
        reason = None if self._start is None else self._ruled_out(self._problem.target)
        if reason is not None:
            self.log.block(reason)
            self.result.shortfall = reason
        return reason is not None

    def _ruled_out(self, target: GraspTarget) -> str | None:
        # What does not get past its neighbours straight up is lifted by no grasp.
        if raised_into(target, RAISED) > 0.0:
            return LIFT_BLOCKED
        if goal := target.demand.request.goal:
            try:
                self._poses = goal_poses(target, goal, self.planner.cell)
            except NoPath as fault:
                return fault.reason
        return None

    def _firm(self, breadth: int, patient: bool) -> bool:
        """Return True if a round gave a firm grasp that can be carried out; weaker feasible ones go to the pool.

        Postures come firmest first, so that a batch without a firm one is the last that is looked at, unless `patient`.
        """
        settings = self.planner.settings.broadened(breadth)
        firm, candidates = settings.firm_load, self.round(self.planner.source, settings)
        for batch in iter(lambda: list(islice(candidates, settings.candidates)), []):
            self.pool += batch
            if self.take(lambda hold: hold.robust_load >= firm):
                return True
            if not patient and max(candidate.hold.robust_load for candidate in batch) < firm:
                return False
        return False

    def round(self, source: ProposalSource, settings: PlannerSettings) -> Iterator[Candidate]:
        """Yield the feasible configurations of one round of proposals, with their squeeze."""
        proposals = source.propose(self._problem.target, settings, self._rng)
        self.log.rounds += 1
        self.log.lap("proposals")
        self.result.shortfall = proposals.failure
        starts = self.planner.starts(proposals, replace(self._problem, settings=settings))
        yield from self.planner.candidates(self._within_goal(starts), self.log)

    def _within_goal(self, starts: Iterator[Posture]) -> Iterator[Posture]:
        """Yield the postures from which the arm reaches the goal too, where there is one."""
        for start in starts:
            if not self._poses or reaches_goal(start.q, self._poses, self._problem.tree):
                yield start
            else:
                self.log.block(OUT_OF_REACH)

    def take(self, enough: Callable[[GraspForces], bool]) -> bool:
        """Return True if a candidate that is good enough can be carried out: found then; failures leave the pool."""
        # What holds the weight comes before what does not, though its merit with less friction may be lower; of many
        # that have none, those that hold more of it.
        self.pool.sort(key=lambda one: (not one.hold.holds, -one.hold.robust_load, -one.hold.share))
        while self.pool and enough(self.pool[0].hold):
            if self.carried_out(self.pool.pop(0)):
                return True
        return False

    def carried_out(self, candidate: Candidate, holding: bool = False) -> bool:
        """Return True if a candidate can be certified and approached; it is found then, and what it lacks noted else.

        Args:
            candidate: the configuration.
            holding: whether its forces must bear the assumed weight, as the certificate says.
        """
        planner, script = self.planner, None
        try:
            grasp = planner.certify(candidate)
        except NoGrasp as lack:
            self.log.block(*lack.args)
            return False
        finally:
            self.log.lap("certificate")
        if holding and not grasp.certificate.holds:
            return False
        try:
            if self._start is not None:
                target = self._problem.target
                among = target.around is not None
                gently = planner.settings.max_force is not None
                script = make_script(
                    self._start,
                    grasp.motion,
                    target.everything,
                    planner.cell,
                    margin=_BESIDE[gently],
                    among=among,
                )
                check_way(script, planner.cell, target)
                if self._poses:
                    script = to_goal(script, self._problem, self._poses)
            self.result.found.append(Planned(completed(grasp, candidate.hold), script))
            return True
        except NoPath as blocked:
            self.log.block(blocked.reason)
            return False
        finally:
            self.log.lap("approach")


_WARM: set[tuple[str, type]] = set()  # cells and kinds of source that this process has planned with


def compile_ahead(cell: Cell, source: ProposalSource | None = None) -> None:
    """Load compiled code and atlas by planning for a small box, once a process: planning times are then times.

    On a machine where nothing is compiled yet, that takes a minute.

    Args:
        cell: of the robot.
        source: of the proposals, for what it needs to be loaded; all triples of the surface by default.
    """
    key = cell.version, type(source)
    if key in _WARM:
        return
    _WARM.add(key)
    with compiling("plan"):
        Planner(source=source, cell=cell).plan(small_box(), 0, cell.robot.home.copy())


def small_box() -> GraspTarget:
    """Return a box of 5 x 7 x 6 cm in front of the robot."""
    return GraspTarget.of_corners([grid((0.475, 0.525), (-0.035, 0.035), (0.0, 0.06))])
