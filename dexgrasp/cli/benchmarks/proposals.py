"""Benchmark of proposal sources: postures and time until a verified grasp, its margin, and the spread of grasps.

Every source serves the same planner on the same perceived hulls, without planning the approach.
"""

import time
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import gymnasium as gym
import numpy as np
from numpy.random import Generator

import dexgrasp_env  # noqa: F401  (registers the environment)
from dexgrasp.cli.benchmarks.timing import spread_of
from dexgrasp.evaluation.statistics import cluster_interval
from dexgrasp.geometry.completion import NoTarget, target_of
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.file import record_of
from dexgrasp.grasp.verify.verify import UNEXECUTED, verify
from dexgrasp.mechanics.kinematics.forward import body_frames
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.mechanics.metrics import ferrari_canny
from dexgrasp.planning.cvae_source import CvaeProposals
from dexgrasp.planning.planner import Planner
from dexgrasp.planning.postures import atlas_postures
from dexgrasp.planning.proposals import Proposals, ProposalSource, SurfaceProposals, graspable_points
from dexgrasp.planning.result import PlanResult
from dexgrasp.planning.settings import GraspProblem, PlannerSettings
from dexgrasp.planning.sqp import solve
from dexgrasp_env.arrays import Fields
from dexgrasp_env.objects.catalogue import OBJECT_SETS
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.robot.cell import default_cell

SETS = ("seen", "familiar", "novel")
_SINGLE = 100  # proposals an object for `each_feasible`
_QUICK, _FULL = (2, 1, 1), (None, 3, 4)  # objects of a set (all), scenes an object, seeds a scene


class UniformProposals(ProposalSource):
    """Triples drawn uniformly, not judged at all: what the other sources must beat."""

    def propose(self, target: GraspTarget, settings: PlannerSettings, rng: Generator) -> Proposals:
        """Return `settings.triples` triples."""
        points, normals = graspable_points(target, settings, rng)
        if len(points) < 3:
            return Proposals.none("no_surface_above_table")
        triples = np.argsort(rng.random((settings.triples, len(points))), axis=1)[:, :3]
        return Proposals(points[triples], normals[triples])


SOURCES = {"cvae": CvaeProposals, "surface": SurfaceProposals, "uniform": UniformProposals}


class Attempt(NamedTuple):
    """One plan: of which scene, how long it took [s], and whether its grasp was verified."""

    scene: str
    plan: PlanResult
    seconds: float
    verified: bool


def run(quick: bool = False) -> Fields:
    """Measure all sources on seen, familiar and novel objects.

    Returns:
        By set and source: `trials`, `verified` with its interval; what a verified grasp costs where attempts that gave
        none count as well, `tried_each` and `seconds_each`: postures and time of all attempts over the verified ones
        (None: there are none). Of the verified alone: medians with bootstrap intervals of `tried`, `seconds`, the
        closure `margin` and Ferrari and Canny's `epsilon` [N], and of those of one scene the mean distance of contact
        centroids (`spread_cm`) and the mean angle between palms (`palm_degrees`). `each_feasible`: single proposals
        that become feasible.
    """
    objects, scenes, seeds = _QUICK if quick else _FULL
    first = replace(
        PlannerSettings(), candidates=1, firm_load=0.0
    )  # the first grasp, not the best of several
    planners = {name: Planner(first, source()) for name, source in SOURCES.items()}
    figures: Fields = {}
    for group in SETS:
        subjects = [
            (f"{name}-{k}", target)
            for name in OBJECT_SETS[group][:objects]
            for k in range(scenes)
            if (target := _perceived(name, 1000 + k)) is not None
        ]
        for name, planner in planners.items():
            planner.plan(subjects[0][1], 0)  # compile, read weights
            attempts = [
                _attempt(planner, scene, target, seed) for scene, target in subjects for seed in range(seeds)
            ]
            shares = [_feasible(planner, SOURCES[name](), target) for _, target in subjects]
            figures[f"{group} {name}"] = _figures(attempts) | {"each_feasible": np.mean(shares)}
    return figures


def _feasible(planner: Planner, source: ProposalSource, target: GraspTarget) -> float:
    """Return the share of single proposals, fingers as given or else by lot, that become a feasible configuration."""
    rng, settings = np.random.default_rng(0), replace(planner.settings, triples=_SINGLE, postures=10**6)
    found = source.propose(target, settings, rng)
    if found.failure:
        return 0.0
    order = np.tile(np.arange(3), (len(found.contacts), 1))
    order = order if found.assigned else rng.permuted(order, axis=1)
    contacts, normals = (
        np.take_along_axis(a, order[:, :, None], axis=1) for a in (found.contacts, found.normals)
    )
    single = Proposals(contacts, normals, assigned=True)
    problem = GraspProblem(target, planner.cell, settings)
    return sum(solve(p.q, problem).feasible for p in atlas_postures(single, problem)) / len(contacts)


def _perceived(name: str, seed: int) -> GraspTarget | None:
    """Return the hull of an object as the depth cameras see it."""
    env = gym.make("DexGrasp/Lift-v2", objects=name, obs_mode="pointcloud", observe="reset")
    try:
        return target_of(Scene.of_observation(env.reset(seed=seed)[0]))
    except NoTarget:
        return None
    finally:
        env.close()


def _attempt(planner: Planner, scene: str, target: GraspTarget, seed: int) -> Attempt:
    began = time.perf_counter()
    plan = planner.plan(target, seed)
    seconds = time.perf_counter() - began
    found = [check for content in plan.contents("hull") for check in verify(record_of(content), UNEXECUTED)]
    return Attempt(scene, plan, seconds, bool(found) and all(check.holds for check in found))


def _figures(attempts: list[Attempt]) -> Fields:
    good, mu = [a for a in attempts if a.verified], PlannerSettings().friction
    grasps = [grasp for a in good for grasp in a.plan.grasps]
    between = [_between(a, b) for a, b in combinations(good, 2) if a.scene == b.scene]
    spread, angle = np.mean(between, axis=0) if between else (None, None)
    rate = len(good) / len(attempts)
    tried: list[float] = [a.plan.log.tried for a in attempts]
    moved = [(a.scene, (a.verified - rate) / len(attempts)) for a in attempts]
    return {
        "trials": len(attempts), "verified": rate,
        "verified_ci95": cluster_interval(rate, moved, len(attempts)),
        "tried": spread_of([a.plan.log.tried for a in good]), "seconds": spread_of([a.seconds for a in good]),
        "margin": spread_of([grasp.certificate.closure_margin for grasp in grasps]),
        "epsilon": spread_of([ferrari_canny(grasp.contacts, grasp.normals, mu) for grasp in grasps]),
        "tried_each": _each(tried, good),
        "seconds_each": _each([a.seconds for a in attempts], good),
        "mean_tried": np.mean(tried),
        "proposal_seconds": np.median([a.plan.log.seconds.get("proposals", 0.0) for a in attempts]),
        "spread_cm": spread, "palm_degrees": angle,
    }  # fmt: skip


def _each(spent: list[float], good: list[Attempt]) -> float | None:
    """Return what all attempts spent over the grasps that were verified; None where none was."""
    return sum(spent) / len(good) if good else None


def _between(a: Attempt, b: Attempt) -> tuple[float, float]:
    """Return how far apart two grasps are: their contacts, cm, and the angle of their palms, degrees."""
    tree, (first, second) = robot_tree(default_cell()), (a.plan.grasps[0], b.plan.grasps[0])
    apart = np.linalg.norm(first.contacts.mean(0) - second.contacts.mean(0))
    R_a, R_b = (body_frames(grasp.q, tree)[0][tree.palm] for grasp in (first, second))
    turn = np.arccos(np.clip(0.5 * (np.trace(R_a.T @ R_b) - 1.0), -1.0, 1.0))
    return 100.0 * float(apart), float(np.degrees(turn))
