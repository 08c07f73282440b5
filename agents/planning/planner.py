"""From an object to a certified grasp: proposals, postures, bilevel programme, forces, opening, approach."""

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from agents.execution.motion import GraspMotion, NoPath
from agents.execution.script import ActionScript, make_script
from agents.kinematics.clearance import clearance_rows
from agents.kinematics.forward import body_frames
from agents.kinematics.tree import RobotTree, robot_tree
from agents.physics.forces import HoldingForces, holding_forces
from agents.physics.ratios import wrench_ratios
from agents.physics.wrench import solve_wrench_qp
from agents.planning.bilevel import Solution, solve
from agents.planning.certificate import Certificate
from agents.planning.grasp import Grasp, finger_jacobians, grasp_motion, openings
from agents.planning.postures import Posture, atlas_postures, oriented_postures
from agents.planning.proposals import Proposals, ProposalSource, SurfaceProposals, placement_risk
from agents.planning.settings import PlannerSettings
from agents.planning.subject import Subject
from dexgrasp_env.robot.limits import HOME

Array = NDArray[np.float64]
_TORQUE_LIMIT = 0.7  # Nm
_OPEN_CLEARANCE = 0.004  # m between the open hand and the object, table and itself
NO_POSTURE, BUDGET = "no_reachable_posture", "time_budget"


@dataclass
class Plan:
    """The outcome of planning.

    Attributes:
        grasp: the first certified grasp that can be carried out, or None.
        script: its actions, where an approach was asked for.
        reason: why there is none: the constraint that blocked most often.
        seconds: time by stage.
        rounds: times that proposals were asked for.
        tried: postures tried.
        blocked: how often each reason blocked, with the smallest violation seen.
    """

    grasp: Grasp | None = None
    script: ActionScript | None = None
    reason: str | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    rounds: int = 0
    tried: int = 0
    blocked: dict[str, tuple[int, float]] = field(default_factory=dict)

    @property
    def total_seconds(self) -> float:
        """Time of all stages."""
        return sum(self.seconds.values())


class Planner:
    """A planner of one robot; its proposals come from any source."""

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
            with_closure: False leaves wrench closure out (the ablation CVAE + kinematics).
        """
        self.settings, self.mount = settings or PlannerSettings(), mount
        self.tree: RobotTree = robot_tree(mount)
        self._source, self._starts, self._with_closure = source or SurfaceProposals(), starts, with_closure

    def plan(self, subject: Subject, seed: int = 0, start: Array | None = None) -> Plan:
        """Return the first grasp that passes everything, with its script if `start` is given.

        Args:
            subject: the object.
            seed: of the proposals.
            start: (23,) rad, set-points the robot approaches from; None plans the grasp alone.
        """
        plan, clock, rng = Plan(), _Clock(), np.random.default_rng(seed)
        feeble: list[Grasp] = []
        for breadth in self.settings.breadths:
            settings = self.settings.broadened(breadth)
            proposals = self._source.propose(subject, settings, rng)
            plan.rounds += 1
            clock.lap(plan, "proposals")
            plan.reason = proposals.failure
            if self._try_all(proposals, subject, settings, start, plan, clock, feeble):
                return plan
        if self._any(feeble, subject, start, plan, clock):
            return plan
        plan.reason = _commonest(plan) if plan.blocked else plan.reason or NO_POSTURE
        return plan

    def _try_all(
        self, proposals: Proposals, subject: Subject, settings: PlannerSettings, start: Array | None, plan: Plan,
        clock: "_Clock", feeble: list[Grasp],
    ) -> bool:  # fmt: skip
        """Try proposals batch by batch; whether one became a grasp that can be carried out.

        A firm grasp is taken at once. Weaker ones wait for the end of the round, and those whose squeeze falls short of
        the assumed weight go to `feeble`, for when there is nothing better.
        """
        weak: list[Grasp] = []
        solutions = self._solutions(proposals, subject, settings, plan, clock)
        while batch := list(islice(solutions, settings.candidates)):
            batch.sort(key=lambda solution: -_merit(solution, subject))
            for solution in batch:
                grasp = self._certify(solution, subject, plan)
                clock.lap(plan, "certificate")
                if grasp is None:
                    continue
                if grasp.certificate.load < settings.firm_load:
                    (weak if grasp.certificate.load >= 1.0 else feeble).append(grasp)
                elif self._carry_out(grasp, subject, start, plan, clock):
                    return True
        return self._any(weak, subject, start, plan, clock)

    def _any(
        self, grasps: list[Grasp], subject: Subject, start: Array | None, plan: Plan, clock: "_Clock"
    ) -> bool:
        """Whether one of the grasps can be carried out; the firmest that can goes into `plan`."""
        firmest = sorted(
            grasps, key=lambda grasp: -grasp.certificate.load - 0.5 * grasp.certificate.closure_margin
        )
        return any(self._carry_out(grasp, subject, start, plan, clock) for grasp in firmest)

    def _solutions(
        self, proposals: Proposals, subject: Subject, settings: PlannerSettings, plan: Plan, clock: "_Clock"
    ) -> Iterator[Solution]:
        """Yield feasible configurations until postures or time run out; note in `plan` what blocked the others."""
        for posture in clock.laps(plan, "postures", self._postures(proposals, subject, settings)):
            if self.settings.seconds is not None and plan.total_seconds > self.settings.seconds:
                _block(plan, BUDGET, 0.0)
                return
            plan.tried += 1
            solution = solve(posture.q, self.tree, subject, self.settings, with_margin=self._with_closure)
            clock.lap(plan, "bilevel")
            if solution.feasible:
                yield solution
            else:
                _block(plan, str(solution.blocking), solution.violation)

    def _carry_out(
        self, grasp: Grasp, subject: Subject, start: Array | None, plan: Plan, clock: "_Clock"
    ) -> bool:
        """Whether the grasp can be approached; its script goes into `plan`."""
        try:
            if start is not None:
                plan.script = make_script(start, grasp.motion, subject.distance, self.mount)
            plan.grasp, plan.reason = grasp, None
            return True
        except NoPath as blocked:
            _block(plan, blocked.reason, 0.0)
            return False
        finally:
            clock.lap(plan, "approach")

    def _postures(
        self, proposals: Proposals, subject: Subject, settings: PlannerSettings
    ) -> Iterator[Posture]:
        if not len(proposals.contacts):
            return
        if self._starts == "atlas":
            yield from atlas_postures(proposals, subject, self.tree, settings)
            return
        for k in range(len(proposals.contacts)):
            yield from oriented_postures(k, proposals, subject, self.tree, settings)

    def _certify(self, solution: Solution, subject: Subject, plan: Plan) -> Grasp | None:
        settings, at = self.settings, solution.evaluation
        hold, mass, load = self._hold(solution, subject)
        if not hold.holds and self._with_closure:
            _block(plan, f"holding_forces: {hold.reason}", hold.residual)
            return None
        motion = self._open(solution.q, at.normals, hold.forces, subject)
        if motion is None:
            _block(plan, "pregrasp_clearance", 0.0)
            return None
        internal = solve_wrench_qp(at.contacts, at.normals, settings.friction)
        ratios = wrench_ratios(at.contacts, internal.forces, subject.centre)
        certificate = Certificate(
            distances_cm=tuple(float(d) for d in 100.0 * (at.distances - settings.tip_radius)),  # type: ignore[arg-type]
            force_ratio_percent=ratios.force,
            torque_ratio_percent=ratios.torque,
            closure_residual=float(internal.residual),
            closure_margin=float(at.margin),
            min_clearance_m=self._clearance(solution.q, subject, tips_touch=True),
            joint_limit_margin_rad=float(
                np.minimum(solution.q - self.tree.lower, self.tree.upper - solution.q).min()
            ),
            max_joint_torque_fraction=float(settings.torque_share * hold.max_torque_fraction),
            holds=bool(hold.holds),
            hold_residual=float(hold.residual),
            mass=mass,
            load=load,
            friction=settings.friction,
        )
        return Grasp(solution.q, at.contacts, at.normals, hold.forces, certificate, motion, self.mount)

    def _hold(self, solution: Solution, subject: Subject) -> tuple[HoldingForces, float, float]:
        """Return the firmest squeeze of `settings.loads` that the joints can hold, and mass and load it is made for."""
        settings, at = self.settings, solution.evaluation
        J = finger_jacobians(solution.q, self.tree)
        for share, disturbance in settings.loads:
            mass = share * subject.mass
            hold = holding_forces(
                at.contacts, at.normals, settings.friction_hold, mass, subject.centre, jacobians=J,
                torque_limits=settings.torque_share * _TORQUE_LIMIT, f_min=settings.least_press, safety=1.0,
                disturbance=disturbance, explain=(share, disturbance) == settings.loads[-1],
            )  # fmt: skip
            if hold.holds:
                break
        return hold, mass, share * (1.0 + disturbance)

    def _open(self, q: Array, normals: Array, forces: Array, subject: Subject) -> GraspMotion | None:
        for opening in openings():
            motion = grasp_motion(q, normals, forces, subject, self.tree, self.settings, opening)
            clear = self._clearance(motion.pregrasp, subject, tips_touch=False)
            if clear > min(_OPEN_CLEARANCE, 0.5 * opening):
                return motion
        return None

    def _clearance(self, q: Array, subject: Subject, tips_touch: bool) -> float:
        R, p = body_frames(q, self.tree)
        values, rows, labels = np.empty(160), np.empty((160, 23)), np.empty((160, 3), np.int64)
        distance = subject.distance
        n = clearance_rows(
            self.tree, R, p, distance.triangles, distance.planes, 0.02, True, tips_touch, values, rows, labels
        )
        return float(values[:n].min()) if n else 0.02


@lru_cache(maxsize=8)
def warm_up(mount: str = "palm_normal") -> None:
    """Load compiled code and atlas by planning for a small box, once a process: planning times are then times."""
    import trimesh

    box = trimesh.creation.box(
        (0.05, 0.07, 0.06), transform=trimesh.transformations.translation_matrix((0.5, 0.0, 0.03))
    )
    Planner(mount=mount).plan(Subject.of(box), 0, np.array(HOME))


class _Clock:
    """Adds the time since the last lap to a stage of a plan."""

    def __init__(self) -> None:
        self._last = time.perf_counter()

    def lap(self, plan: Plan, stage: str) -> None:
        now = time.perf_counter()
        plan.seconds[stage] = plan.seconds.get(stage, 0.0) + now - self._last
        self._last = now

    def laps(self, plan: Plan, stage: str, items: Iterator[Posture]) -> Iterator[Posture]:
        for item in items:
            self.lap(plan, stage)
            yield item
        self.lap(plan, stage)


def _merit(solution: Solution, subject: Subject) -> float:
    """Which of several feasible configurations bears errors best: its margin, less what places its contacts at risk."""
    at = solution.evaluation
    return min(at.margin, 0.8) - float(placement_risk(at.contacts[None], at.normals[None], subject)[0])


def _block(plan: Plan, reason: str, violation: float) -> None:
    count, least = plan.blocked.get(reason, (0, np.inf))
    plan.blocked[reason] = (count + 1, min(least, violation))


def _commonest(plan: Plan) -> str:
    """The blocking constraint, without the fingers' and bodies' names, that stopped most postures."""
    totals: Counter[str] = Counter()
    for reason, (count, _) in plan.blocked.items():
        totals[reason.split(":")[0]] += count
    return totals.most_common(1)[0][0]
