"""Many grasps of one scene: the firmest, then always the one farthest from those that are chosen.

The way from proposal to grasp is the planner's own; it goes on where the planner would take the firmest and stop.
Feasible configurations that hold are collected, twice as many as are asked for. Greedy selection then takes the one
whose hand is farthest from every hand chosen so far (`variety.hand_points`), and only what is chosen gets its opening,
certificate and approach; where that fails, the next farthest takes its place.
"""

import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np

from dexgrasp.grasp.variety import hand_points
from dexgrasp.planning.certifier import Candidate
from dexgrasp.planning.planner import NO_POSTURE, Planner, Search
from dexgrasp.planning.postures import Posture
from dexgrasp.planning.proposals import ProposalSource, SurfaceProposals
from dexgrasp.planning.result import PlanResult, Progress
from dexgrasp.planning.settings import GRASPS
from dexgrasp.shape.target import GraspTarget
from dexgrasp_env.arrays import Array
from dexgrasp_env.valid import check

_POOL = 2.0  # times as many configurations are chosen among as are asked for
_ROUND = (32, 400)  # triples a round, at least and at most
_SPARE = 1.3  # triples a configuration that is wanted: not all become feasible
_DRY = 0.1  # of what is wanted: a source that brings less in a round has no more
_APART = 0.005  # m between two hands that are not the same


def plan_many(
    planner: Planner, target: GraspTarget, count: int, seed: int = 0, start: Array | None = None,
    progress: Progress | None = None,
) -> PlanResult:  # fmt: skip
    """Return up to `count` grasps that differ, each certified, bearing the assumed weight, and within reach.

    Args:
        planner: whose proposals, thresholds and certificates; surface triples follow where its source has no more.
        target: the object.
        count: grasps asked for, 1 to `settings.MOST`.
        seed: of the proposals.
        start: (23,) rad, set-points the robot approaches from; None plans the grasps alone.
        progress: called with steps done and steps in all.

    Raises:
        InputError: for a count out of range.
    """
    check("count", count, GRASPS)
    began = time.process_time()
    result = _Search(planner, target, seed, start, count).run(count, _rising(progress))
    result.cpu_seconds = time.process_time() - began
    return result


def _rising(progress: Progress | None) -> Progress:
    """Report no step back: what was collected may be refused later."""
    most = 0

    def report(done: int, of: int) -> None:
        nonlocal most
        most = max(most, done)
        if progress is not None:
            progress(most, of)

    return report


class _Pool:
    """Configurations that hold, and how far each one's hand is from the nearest that was chosen."""

    def __init__(self) -> None:
        self._all: list[Candidate[Posture]] = []
        self._points = np.empty((256, 18))  # m
        self._gaps = np.empty(256)  # m; infinite while nothing is chosen, -1 for what has been taken
        self._chosen: list[Array] = []

    def __len__(self) -> int:
        return int((self._gaps[: len(self._all)] >= 0.0).sum())

    def add(self, candidate: Candidate[Posture], points: Array) -> bool:
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

    def take(self) -> tuple[int, Candidate[Posture]]:
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


class _Search(Search):
    """Collects configurations that hold, and chooses among them."""

    def run(self, count: int, progress: Progress) -> PlanResult:
        """Collect and choose in turns, until there are enough or nothing new comes."""
        result, room = self.result, round(_POOL * count)
        pool, sources = _Pool(), list[ProposalSource]([self.planner.source, SurfaceProposals()])
        while left := count - len(result.found):
            if len(pool) < left and sources:
                for _ in self._collect(pool, sources, round(_POOL * left) - len(pool)):
                    progress(min(len(pool) + len(result.found), room), room + count)
                continue
            if not len(pool):
                result.shortfall = self.log.commonest() or result.shortfall or NO_POSTURE
                break
            self._choose(pool)
            progress(room + len(result.found), room + count)
        if len(result.found) == count:
            result.shortfall = None
        result.found.sort(key=lambda planned: -planned.grasp.certificate.load)
        return result

    def _collect(self, pool: "_Pool", sources: list[ProposalSource], wanted: int) -> Iterator[None]:
        """Put configurations that hold into the pool, one a step; a source that brings nothing new is left."""
        new, size = 0, int(np.clip(_SPARE * wanted, *_ROUND))
        settings = replace(self.planner.settings, triples=size, postures=size)
        for candidate in islice(self.round(sources[0], settings), wanted):
            if not candidate.hold.holds:
                self.log.block("holding_forces")
                continue
            at = candidate.solution
            if pool.add(candidate, hand_points(at.q, at.evaluation.contacts, self.planner.tree)):
                new += 1
                yield
        if new < _DRY * min(wanted, size):
            del sources[0]

    def _choose(self, pool: "_Pool") -> None:
        """Choose the farthest candidate if it can be certified and carried out."""
        k, candidate = pool.take()
        grasp = self.certified(candidate)
        if grasp is not None and grasp.certificate.holds and self.carried_out(grasp):
            pool.choose(k)
