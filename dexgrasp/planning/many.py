"""Many grasps of one scene: the firmest, then always the one farthest from those that are chosen.

The way from proposal to grasp is the planner's own; it goes on where the planner would take the firmest and stop.
Feasible configurations that hold are collected, twice as many as are asked for. Greedy selection then takes the one
whose hand is farthest from every hand chosen so far (`variety.hand_points`), and only what is chosen gets its opening,
certificate and approach; where that fails, the next farthest takes its place.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any

import numpy as np

from dexgrasp.grasp.variety import component_shares, grasp_features, hand_points
from dexgrasp.planning.holding import firmest_hold
from dexgrasp.planning.plan import Clock, Plan
from dexgrasp.planning.planner import NO_POSTURE, Candidate, Planner
from dexgrasp.planning.proposals import ProposalSource, SurfaceProposals
from dexgrasp.shape.target import GraspTarget
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError

MOST = 10_000
"""Grasps of one scene that can be asked for."""
_POOL = 2.0  # times as many configurations are chosen among as are asked for
_ROUND = (32, 400)  # triples a round, at least and at most
_SPARE = 1.3  # triples a configuration that is wanted: not all become feasible
_DRY = 0.1  # of what is wanted: a source that brings less in a round has no more
_APART = 0.005  # m between two hands that are not the same

Progress = Callable[[int, int], None]


@dataclass
class GraspSet:
    """Grasps of one scene.

    Attributes:
        plans: one a grasp, each with its script where an approach was asked for; by load, firmest first.
        search: the search as a whole: seconds by stage, what blocked; its reason says why there are fewer than asked.
        cpu_seconds: processor time of all.
    """

    plans: list[Plan] = field(default_factory=list)
    search: Plan = field(default_factory=Plan)
    cpu_seconds: float = 0.0

    @property
    def diversity(self) -> list[float]:
        """Share of variance in the first 1 to 5 principal components of palm pose and joints; lower is more varied."""
        return component_shares(
            np.array([grasp_features(p.grasp) for p in self.plans if p.grasp is not None])
        )

    @property
    def per_second(self) -> float:
        """Grasps a second of one core."""
        return len(self.plans) / max(self.cpu_seconds, 1e-9)

    def as_json(self, contents: Sequence[dict[str, Any] | None], asked: int) -> dict[str, Any]:
        """Return what `dexgrasp plan --count K --json` prints of a set, given its grasps as files hold them."""
        return {
            "asked": asked, "count": len(contents), "grasps_per_cpu_second": self.per_second,
            "diversity": self.diversity, "grasps": list(contents),
        }  # fmt: skip


def plan_many(
    planner: Planner, target: GraspTarget, count: int, seed: int = 0, start: Array | None = None,
    progress: Progress | None = None,
) -> GraspSet:  # fmt: skip
    """Return up to `count` grasps that differ, each certified, bearing the assumed weight, and within reach.

    Args:
        planner: whose proposals, thresholds and certificates; surface triples follow where its source has no more.
        target: the object.
        count: grasps asked for, 1 to `MOST`.
        seed: of the proposals.
        start: (23,) rad, set-points the robot approaches from; None plans the grasps alone.
        progress: called with steps done and steps in all.

    Raises:
        InputError: for a count out of range.
    """
    check_count(count)
    began = time.process_time()
    found = _Search(planner, target, seed, start).run(count, _rising(progress))
    found.cpu_seconds = time.process_time() - began
    return found


def _rising(progress: Progress | None) -> Progress:
    """Report no step back: what was collected may be refused later."""
    most = 0

    def report(done: int, of: int) -> None:
        nonlocal most
        most = max(most, done)
        if progress is not None:
            progress(most, of)

    return report


def check_count(count: int) -> None:
    """Refuse a number of grasps that is none.

    Raises:
        InputError: if it is not a whole number from 1 to `MOST`.
    """
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MOST:
        raise InputError(
            f"count is {count!r}: valid are whole numbers from 1 to {MOST} (`dexgrasp dataset generate` makes more)"
        )


class _Pool:
    """Configurations that hold, and how far each one's hand is from the nearest that was chosen."""

    def __init__(self) -> None:
        self._all: list[Candidate] = []
        self._points = np.empty((256, 18))  # m
        self._gaps = np.empty(256)  # m; infinite while nothing is chosen, -1 for what has been taken
        self._chosen: list[Array] = []

    def __len__(self) -> int:
        return int((self._gaps[: len(self._all)] >= 0.0).sum())

    def add(self, candidate: Candidate, points: Array) -> bool:
        """Add a candidate with its hand's points (6, 3), unless one like it was here before."""
        n, flat = len(self._all), points.ravel()
        if n and _distance(self._points[:n], flat).min() < _APART:
            return False
        if n == len(self._gaps):
            self._points, self._gaps = np.tile(self._points, (2, 1)), np.tile(self._gaps, 2)
        self._all.append(candidate)
        self._points[n] = flat
        self._gaps[n] = _distance(np.array(self._chosen), flat).min() if self._chosen else np.inf
        return True

    def take(self) -> tuple[int, Candidate]:
        """Take out the farthest from what is chosen; of several such, as at the beginning, the firmest."""
        gaps = self._gaps[: len(self._all)]
        ties = np.flatnonzero(gaps == gaps.max())
        k = int(max(ties, key=lambda i: self._all[i].hold.merit))
        self._gaps[k] = -1.0
        return k, self._all[k]

    def choose(self, k: int) -> None:
        """Choose what was taken as number `k`."""
        n = len(self._all)
        self._chosen.append(self._points[k].copy())
        left = self._gaps[:n] >= 0.0
        apart = _distance(self._points[:n], self._points[k])
        self._gaps[:n] = np.where(left, np.minimum(self._gaps[:n], apart), -1.0)


def _distance(points: Array, to: Array) -> Array:
    """Root mean square distance (N,) m of hands' points (N, 18) to those of one (18,)."""
    return np.asarray(np.sqrt(((points - to) ** 2).sum(1) / 6.0))


class _Search:
    def __init__(self, planner: Planner, target: GraspTarget, seed: int, start: Array | None) -> None:
        self._planner, self._target, self._start = planner, target, start
        self._rng = np.random.default_rng(seed)
        self._sources: list[ProposalSource] = [planner.source, SurfaceProposals()]
        self._pool, self._found = _Pool(), GraspSet()
        self._clock = Clock(self._found.search)

    def run(self, count: int, progress: Progress) -> GraspSet:
        """Collect and choose in turns, until there are enough or nothing new comes."""
        plans, search, room = self._found.plans, self._found.search, round(_POOL * count)
        while left := count - len(plans):
            if len(self._pool) < left and self._sources:
                for _ in self._collect(round(_POOL * left) - len(self._pool)):
                    progress(min(len(self._pool) + len(plans), room), room + count)
                continue
            if not len(self._pool):
                search.reason = search.commonest() or search.reason or NO_POSTURE
                break
            self._take()
            progress(room + len(plans), room + count)
        if len(plans) == count:
            search.reason = None
        plans.sort(key=lambda plan: -_load(plan))
        return self._found

    def _collect(self, wanted: int) -> Iterator[Candidate]:
        """Put configurations that hold into the pool and yield them; a source that brings nothing new is left."""
        planner, search, new = self._planner, self._found.search, 0
        size = int(np.clip(_SPARE * wanted, *_ROUND))
        settings = replace(planner.settings, triples=size, postures=size)
        proposals = self._sources[0].propose(self._target, settings, self._rng)
        search.rounds, search.reason = search.rounds + 1, proposals.failure
        self._clock.lap("proposals")
        solutions = planner.solutions(proposals, self._target, settings, search, self._clock)
        for solution in islice(solutions, wanted):
            hold = firmest_hold(solution.q, self._target, planner.tree, planner.settings)
            candidate = Candidate(solution, hold)
            self._clock.lap("certificate")
            if self._holds(candidate):
                new += 1
                yield candidate
        if new < _DRY * min(wanted, size):
            del self._sources[0]

    def _holds(self, candidate: Candidate) -> bool:
        """Whether a candidate holds and is like no other: it is in the pool then."""
        if not candidate.hold.holds:
            self._found.search.block("holding_forces")
            return False
        at = candidate.solution
        return self._pool.add(candidate, hand_points(at.q, at.evaluation.contacts, self._planner.tree))

    def _take(self) -> None:
        """Choose the farthest candidate if it can be certified and carried out."""
        k, candidate = self._pool.take()
        search, plan = self._found.search, Plan()
        grasp = self._planner.certifier.certify(candidate.solution, candidate.hold, self._target, search)
        self._clock.lap("certificate")
        if grasp is None or not grasp.certificate.holds:
            return
        if self._planner.carry_out(grasp, self._target, self._start, plan, self._clock):
            self._pool.choose(k)
            self._found.plans.append(plan)
        for reason, (_, violation) in plan.blocked.items():
            search.block(reason, violation)


def _load(plan: Plan) -> float:
    return 0.0 if plan.grasp is None else plan.grasp.certificate.load
