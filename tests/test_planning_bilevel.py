"""The optimiser and the planner: feasible results, reasons, budgets, repeatability."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from planned import lying
from robots import CELL, HOME, LOWER, UPPER

from dexgrasp.geometry.target import GraspTarget
from dexgrasp.mechanics.contacts import shape_of
from dexgrasp.mechanics.kinematics.forward import fingertips
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.planning.constraints import evaluate
from dexgrasp.planning.planner import Planner
from dexgrasp.planning.postures import atlas_postures
from dexgrasp.planning.proposals import SurfaceProposals
from dexgrasp.planning.settings import GraspProblem, PlannerSettings
from dexgrasp.planning.sqp import TOLERANCE, bounds_of, solve

TREE, SETTINGS = robot_tree(CELL), PlannerSettings()


BOX = lying((0.05, 0.08, 0.12))
HUGE = lying((0.5, 0.5, 0.5), at=(0.6, 0.0))
PROBLEM = GraspProblem(BOX, CELL, SETTINGS)
FAR = lying((0.05, 0.08, 0.12), at=(1.4, 0.0))
PLATE = lying((0.3, 0.2, 0.002))


@pytest.fixture(scope="module")
def solutions():
    proposals = SurfaceProposals().propose(BOX, SETTINGS, np.random.default_rng(0))
    return [solve(p.q, PROBLEM) for p in atlas_postures(proposals, PROBLEM)]


@pytest.fixture(scope="module")
def plan():
    return Planner().plan(BOX, 0, HOME)


def constraints(q, settings=SETTINGS):
    bounds = bounds_of(GraspProblem(BOX, CELL, settings), settings.closure_margin)
    return evaluate(q, TREE, BOX.distance.obstacle, PROBLEM.world, bounds, shape_of(3), True)


@pytest.mark.parametrize("height", [0.015, 0.02])
def test_tips_come_in_level_beside_a_low_object(height):
    low = lying((0.12, 0.08, height))
    found = SurfaceProposals().propose(low, SETTINGS, np.random.default_rng(0))
    contacts, normals = found.contacts.reshape(-1, 3), found.normals.reshape(-1, 3)
    assert SETTINGS.lowest_contact(low.top) <= contacts[:, 2].min() <= contacts[:, 2].max() <= height + 1e-9
    assert (contacts + (SETTINGS.tip_radius + SETTINGS.distance[1]) * normals)[
        :, 2
    ].min() > SETTINGS.tip_radius
    assert normals[:, 2].max() < 0.1  # an even sample of the surface has nothing but its top
    plan = Planner().plan(low, 0, HOME)
    assert plan.reason is None
    motion, tree = plan.grasp.motion, robot_tree(CELL)
    heights = [fingertips(q, tree)[:, 2] for q in (motion.pregrasp, motion.grasp)]
    assert np.abs(heights[0] - heights[1]).max() < 0.006


def test_most_starts_become_feasible_and_feasible_means_feasible(solutions):
    feasible = [s for s in solutions if s.feasible]
    assert len(feasible) > 0.5 * len(solutions)
    for s in feasible:
        assert s.blocking is None
        assert constraints(s.q).values.min() >= -TOLERANCE
        low, high = SETTINGS.distance
        depth = s.evaluation.distances - SETTINGS.tip_radius
        assert ((depth >= low - 1e-6) & (depth <= high + 1e-6)).all()
        assert s.evaluation.margin >= SETTINGS.closure_margin - 1e-4
        assert (s.q >= LOWER + SETTINGS.joint_margin - 1e-9)[[*range(15), *range(19, 23)]].all()
        assert (s.q <= UPPER - SETTINGS.joint_margin + 1e-9)[[*range(15), *range(19, 23)]].all()


def test_plan_is_whole_and_repeats_itself(plan):
    again, other = Planner().plan(BOX, 0, HOME), Planner().plan(BOX, 1, HOME)
    assert plan.reason is None
    assert set(plan.log.seconds) >= {"proposals", "postures", "bilevel", "certificate", "approach"}
    for name in ("q", "contacts", "normals", "forces"):
        assert_array_equal(getattr(plan.grasp, name), getattr(again.grasp, name))
    for name in ("pregrasp", "grasp", "squeeze"):
        assert_array_equal(getattr(plan.grasp.motion, name), getattr(again.grasp.motion, name))
    assert_array_equal(plan.script.targets, again.script.targets)
    assert plan.grasp.certificate == again.grasp.certificate
    assert not np.array_equal(plan.grasp.q, other.grasp.q)


def test_a_heavy_flat_bar_is_searched_for_until_a_grasp_bears_it():
    bar = lying((0.12, 0.03, 0.032))
    heavy = GraspTarget.of(bar.hull, mass=1.5)
    hasty = Planner(PlannerSettings(patience=0))
    weak, strong = hasty.plan(heavy, 0, HOME), Planner().plan(heavy, 0, HOME)
    assert not weak.grasp.certificate.holds  # better than none
    assert strong.grasp.certificate.holds
    assert strong.log.rounds > weak.log.rounds


@pytest.mark.parametrize(
    ("grasp_target", "settings", "reasons"),
    [
        (PLATE, SETTINGS, {"no_surface_above_table"}),
        (FAR, SETTINGS, {"no_reachable_posture"}),
        (HUGE, SETTINGS, {"no_reachable_posture", "no_closure_triple", "no_surface_above_table"}),
        (BOX, replace(SETTINGS, seconds=0.0), {"time_budget"}),
        (BOX, replace(SETTINGS, closure_margin=0.999), {"closure_margin"}),
    ],
)
def test_impossible_tasks_end_with_a_reason_and_within_the_budget(grasp_target, settings, reasons):
    plan = Planner(settings).plan(grasp_target, 0, HOME)
    assert plan.grasp is None
    assert plan.script is None
    assert plan.shortfall in reasons
    assert plan.reason == plan.failure == f"no_grasp:{plan.shortfall}"
    assert plan.log.tried <= (1 + settings.patience) * settings.postures
    if plan.log.tried:
        assert sum(count for count, _ in plan.log.blocked.values()) >= plan.log.tried


def test_without_closure_the_margin_is_not_asked_for():
    plan = Planner(with_closure=False).plan(BOX, 0)
    assert plan.grasp is not None
    assert not any(reason.startswith("closure_margin") for reason in plan.log.blocked)
