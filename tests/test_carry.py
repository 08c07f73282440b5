"""The turn in the air: what it wins, where the object goes, what the fingers then press with."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_less
from planned import lying
from robots import CELL, HOME, ROBOT, denormalise
from tables import table

from dexgrasp.mechanics.kinematics.forward import fingertips
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.motion import move_until_contact
from dexgrasp.motion.carrying import GuardedCarry
from dexgrasp.motion.move_until_contact import GuardedGrasp
from dexgrasp.planning.carry import ENOUGH, plan_turn
from dexgrasp.planning.planner import Planner
from dexgrasp.planning.settings import GraspProblem, PlannerSettings

TREE, SETTINGS = robot_tree(CELL), PlannerSettings()


def planned(mass):
    target = lying((0.05, 0.1, 0.14), mass=mass)
    plan = Planner(SETTINGS).plan(target, 0, np.array(HOME))
    assert plan.grasp is not None
    return plan, target


@pytest.fixture(scope="module")
def heavy():
    plan, target = planned(0.6)
    return plan, target, plan_turn(plan.grasp, plan.script, GraspProblem(target, CELL, SETTINGS))


def at_the_end_of(turn, plan):
    """Return set-points (23,) before the turn, and the arm's (23,) after it."""
    start = plan.script.phases["lift"][-1]
    return start, np.concatenate([turn.arm[-1], start[7:]])


def test_a_heavy_object_is_turned_about_its_centre_and_no_corner_sinks(heavy):
    plan, target, turn = heavy
    start, end = at_the_end_of(turn, plan)
    (R0, p0), (R1, p1) = palm_frame(start, TREE), palm_frame(end, TREE)
    R = R1 @ R0.T
    angle = np.arccos(0.5 * (np.trace(R) - 1.0))
    assert np.abs(np.rad2deg(angle) - [30.0, 45.0, 60.0]).min() < 1.0
    centre = target.centre + p0 - palm_frame(plan.grasp.q, TREE)[1]
    after = p1 + R @ (centre - p0)
    assert_allclose(after[:2], centre[:2], atol=0.005)
    corners = target.hull.vertices - target.centre
    assert (after + corners @ R.T)[:, 2].min() >= (centre + corners)[:, 2].min() - 0.005
    assert_array_less(np.abs(np.diff(turn.arm, axis=0, prepend=start[None, :7])), 0.12)


@pytest.mark.parametrize(("pace", "slow", "touches"), [(1.0, 0, False), (0.4, 0, True), (0.4, 0.2, False)])
def test_a_gentle_hand_has_touched_where_a_finger_lags_to_any_side(heavy, pace, slow, touches, monkeypatch):
    plan, servos = heavy[0], TREE._replace()
    vars(servos).update(response=TREE.response + slow)  # s that set-points are ahead without a touch
    monkeypatch.setattr(move_until_contact, "robot_tree", lambda cell: servos)
    hold = GuardedGrasp(plan.script, plan.grasp, pace=pace)
    q = hold.targets.copy()
    first, end = TREE.fingers[0]
    turns = 1e-6 * np.eye(len(q))[first:end]
    J = 1e6 * np.array([fingertips(q + turn, TREE)[0] - fingertips(q, TREE)[0] for turn in turns]).T
    # It leaves the tip where it is along the normal.
    aside = np.linalg.svd(np.vstack([plan.grasp.normals[0] @ J]))[2][1]
    q[first:end] += 2e-3 * aside / np.linalg.norm(J @ aside)
    hold._close(q)
    assert hold._touched.tolist() == [touches, False, False]


def test_what_must_not_be_pressed_hard_is_not_turned(heavy):
    plan, target, turn = heavy
    gentle = GraspProblem(target, CELL, PlannerSettings(max_force=8.0))
    assert turn is not None
    assert plan_turn(plan.grasp, plan.script, gentle) is None


def test_what_is_held_firmly_is_carried_as_it_was_lifted():
    plan, target = planned(0.08)
    assert plan.grasp.certificate.capacity >= ENOUGH
    assert plan_turn(plan.grasp, plan.script, GraspProblem(target, CELL, SETTINGS)) is None


def carried(motion, turn):
    """Return what follows on a motion: what has been taken hold of is carried."""
    return GuardedCarry(motion, turn) if isinstance(motion, GuardedGrasp) and motion.done else motion


@pytest.mark.parametrize(("free", "turned", "lost"), table("let_go"))
def test_one_free_finger_of_what_hangs_is_no_loss(heavy, free, turned, lost):
    plan, _, turn = heavy
    grasp, script = plan.grasp, plan.script
    execution = GuardedGrasp(script, grasp)
    touching, q = script.phases["close"][-1], script.start
    for step in range(len(script.targets) + 60):
        execution = carried(execution, turn if turned else None)
        q = denormalise(execution.action(q), ROBOT)
        if step >= len(script.phases["approach"]):
            q[7:] = touching[7:]
        if step > len(script.targets):
            for columns in (slice(19, 23), slice(7, 11), slice(11, 15))[:free]:
                q[columns] = execution._pressed[columns]
    assert execution.lost == lost
