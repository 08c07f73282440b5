"""Many grasps of one scene: the firmest, then always the one farthest from those that are chosen.

The way from proposal to grasp is the planner's own; it goes on where the planner would take the firmest and stop.
Feasible configurations that hold are collected, four times as many as are asked for. Greedy selection then takes the
one whose hand is farthest from every hand chosen so far (`variety.hand_points`), and only what is chosen gets its
opening, certificate and approach; where that fails, the next farthest takes its place.

Where it is asked how likely a grasp is to hold (`plan --at-least P`), those remain that are likely enough, or none.
"""

import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np

from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.diversity import hand_points
from dexgrasp.grasp.planned_record import planned_record
from dexgrasp.grasp.record import HoldsProbability
from dexgrasp.planning.certifier import Candidate
from dexgrasp.planning.planner import NO_POSTURE, Planner, Search
from dexgrasp.planning.proposals import ProposalSource, SurfaceProposals
from dexgrasp.planning.result import Planned, PlanResult, Progress
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import Natural, checked

_POOL = 4.0  # times as many configurations are chosen among as are asked for
UNSURE = "not_sure_enough"


@checked
def plan_many(
    planner: Planner, target: GraspTarget, seed: Natural = 0, start: Array | None = None,
    progress: Progress | None = None,
) -> PlanResult:  # fmt: skip
    """Return as many grasps that differ as a planner is asked for, each certified, bearing the weight and in reach.

    Args:
        planner: whose request, proposals, thresholds and certificates; surface triples follow where its source has no
            more.
        target: the object.
        seed: of the proposals.
        start: (23,) rad, set-points the robot approaches from; None plans the grasps alone.
        progress: called with steps done and steps in all.
    """
    began = time.process_time()
    count = planner.request.count or 1
    result = _Search(planner, target, seed, start).chosen(count, _rising(progress))
    result.cpu_seconds = time.process_time() - began
    return result


def _rising(progress: Progress | None) -> Progress:
    """Report no step back: what was collected may be refused later."""
    most = 0

    def report(done: int, of: int) -> None:
        """Report the most that was ever done."""
        nonlocal most
        most = max(most, done)
        if progress is not None:
            progress(most, of)

    return report


class _Pool:
    """Configurations that hold, and how far each one's hand is from the nearest that was chosen."""

    def __init__(self) -> None:
        self._all: list[Candidate] = []
        self._points = np.empty((0, 0))  # m
        self._gaps = np.empty(0)  # m; infinite while nothing is chosen, -1 for what has been taken
        self._chosen: list[int] = []

    def __len__(self) -> int:
        return int((self._gaps >= 0.0).sum())

    def add(self, candidate: Candidate, points: Array) -> bool:
        """Add a candidate with its hand's points (m, 3), unless one like it was here before."""
        flat = points.ravel()
        self._points = self._points.reshape(-1, len(flat))
        if (_distance(self._points, flat) < 0.005).any():  # m between two hands that are not the same
            return False
        gap = _distance(self._points[self._chosen], flat).min(initial=np.inf)
        self._all.append(candidate)
        self._points, self._gaps = np.vstack([self._points, flat]), np.append(self._gaps, gap)
        return True

    def take(self) -> tuple[int, Candidate]:
        """Take out the farthest from what is chosen; of several such, as at the beginning, the firmest."""
        ties = np.flatnonzero(self._gaps == self._gaps.max())
        k = int(max(ties, key=lambda i: self._all[i].hold.robust_load))
        self._gaps[k] = -1.0
        return k, self._all[k]

    def choose(self, k: int) -> None:
        """Choose what was taken as number `k`."""
        self._chosen.append(k)
        apart = _distance(self._points, self._points[k])
        self._gaps = np.where(self._gaps >= 0.0, np.minimum(self._gaps, apart), -1.0)


def _distance(points: Array, to: Array) -> Array:
    """Root mean square distance (N,) m of hands' points (N, 3 m) to those of one (3 m,)."""
    return np.sqrt(((points - to) ** 2).sum(1) / (len(to) / 3.0))


class _Search(Search):
    """Collects configurations that hold, and chooses among them."""

    def chosen(self, count: int, progress: Progress) -> PlanResult:
        """Collect and choose in turns, until there are enough or nothing new comes."""
        result, room = self.result, round(_POOL * count)
        result.asked = count
        if self.is_hopeless():
            return result
        pool, sources = _Pool(), list[ProposalSource]([self.planner.source, SurfaceProposals()])
        while left := count - len(result.found):
            if len(pool) < left and sources:
                for _ in self._collect(pool, sources, round(_POOL * left) - len(pool)):
                    progress(min(len(pool) + len(result.found), room), room + count)
                continue
            if not len(pool):
                result.shortfall = self.log.commonest() or result.shortfall or NO_POSTURE
                break
            k, farthest = pool.take()
            if self.carried_out(farthest, holding=True):
                pool.choose(k)
            progress(room + len(result.found), room + count)
        if len(result.found) == count:
            result.shortfall = None
        result.found.sort(key=lambda planned: -planned.grasp.certificate.load)
        return result

    def _collect(self, pool: "_Pool", sources: list[ProposalSource], wanted: int) -> Iterator[None]:
        """Put configurations that hold into the pool, one a step; a source that brings nothing new is left."""
        new, size = 0, int(np.clip(1.3 * wanted, 32, 400))  # triples: not all become feasible
        settings = replace(self.planner.settings, triples=size, postures=size)
        for candidate in islice(self.round(sources[0], settings), wanted):
            if not candidate.hold.holds:
                self.log.block("holding_forces")
                continue
            at = candidate.solution
            if pool.add(candidate, hand_points(at.q, at.evaluation.contacts, self.planner.tree)):
                new += 1
                yield
        if new < 0.1 * min(wanted, size):  # a source that brings less in a round has no more
            del sources[0]


def with_success_probability(
    result: PlanResult, planner: Planner, start: Array | None, progress: Progress | None = None
) -> PlanResult:
    """Return a plan without the grasps that are less likely to be lifted and held than the planner's request asks.

    Where one grasp was asked for and is not likely enough, the likeliest of others takes its place if that is.

    Args:
        result: of the planner, with a target.
        planner: that made it.
        start: (n,) rad, set-points the robot approaches from.
        progress: called with steps done and steps in all.

    Raises:
        InputError: where no probability is known: of another robot, among neighbours, on very slippery surfaces.
    """
    least = planner.request.min_probability or 0.0
    result.found = _likely(result, result.found, least)
    if UNSURE in result.log.blocked:
        if not result.found and result.asked is None and result.target is not None:
            more = planner.asking(replace(planner.request, count=24))
            others = plan_many(more, result.target, result.seed, start, progress)
            result.found = _likely(result, others.found, least)[:1]
        if not result.success:
            result.shortfall = UNSURE
    return result


def _likely(result: PlanResult, found: list[Planned], least: float) -> list[Planned]:
    """Return those that are likely enough, the likeliest first where one was asked for; note what the others lack."""
    chances = np.array([chances_of(one, result).lifted.value for one in found])
    for chance in chances[chances < least]:
        result.log.block(UNSURE, float(least - chance))
    order = np.argsort(-chances, kind="stable") if result.asked is None else np.arange(len(found))
    return [found[k] for k in order if chances[k] >= least]


def chances_of(planned: Planned, result: PlanResult) -> HoldsProbability:
    """Return how likely a grasp of a plan is to hold.

    Raises:
        InputError: where no model knows.
    """
    assert result.target is not None
    known = planned_record("", planned.grasp, result.target, result.settings).holds_probability
    if known is None:
        raise InputError(
            "min_probability (--at-least): how likely a grasp holds is known of the Panda with the Allegro hand alone, "
            "of objects without neighbours, on surfaces of friction 0.7 or more, where nothing else is asked for"
        )
    return known
