"""Planning among neighbours, kept clear of and seen; and of what lies flat: pushed over the edge, grasped there."""

from dataclasses import replace
from itertools import product

import gymnasium as gym
import numpy as np
import pytest
import trimesh
from lift_envs import finished
from numpy.testing import assert_allclose
from refusals import rejected
from robots import CELL, HOME

from dexgrasp.agent import public_info
from dexgrasp.agents import bilevel, stages
from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.geometry.completion import target_of
from dexgrasp.geometry.neighbours import SEEN, columns, neighbours_of
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.planned_record import Origin, planned_record
from dexgrasp.grasp.verify.scene import Scene as Judge
from dexgrasp.grasp.verify.verify import verify
from dexgrasp.mechanics.kinematics.clearance import NEIGHBOUR
from dexgrasp.mechanics.kinematics.forward import fingertips
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.motion.collision import carried_into, raised_into
from dexgrasp.motion.motion import NoPath
from dexgrasp.motion.script import check_way, make_script
from dexgrasp.motion.slide import Push, Slide, make_slide, tips_apart
from dexgrasp.planning.certificate_builder import overlap, too_near
from dexgrasp.planning.certifier import _in_the_way
from dexgrasp.planning.overhang import plan_slid, plan_slide, pushes, slid
from dexgrasp.planning.planner import Planner, Search
from dexgrasp.planning.proposals import Proposals, SurfaceProposals
from dexgrasp.planning.rearrange import plan_rearrangement
from dexgrasp.planning.result import PlanResult
from dexgrasp.planning.settings import GraspProblem, PlannerSettings
from dexgrasp_env.perception.scene import ObjectCloud, Scene
from dexgrasp_env.scene.constants import TABLE_CENTRE_X, TABLE_SIZE

TREE = robot_tree(CELL)
SEED = 4


def box(x, y, size, low=0.0, turn=0.0):
    c, s = np.cos(turn), np.sin(turn)
    corners = np.array([*product((-0.5, 0.5), repeat=3)]) * size
    return corners @ [[c, s, 0], [-s, c, 0], [0, 0, 1]] + [x, y, low + 0.5 * size[2]]


ALONE = GraspTarget.of_corners([box(0.5, 0.0, (0.05, 0.07, 0.1))])
SIDES = tuple((box(0.5, side * 0.085, (0.08, 0.04, 0.12)),) for side in (-1, 1))
BESIDE = replace(ALONE, neighbours=SIDES)


@pytest.fixture(scope="module")
def plans():
    return tuple(Planner().plan(target, SEED, HOME) for target in (ALONE, BESIDE))


def least(script, parts):
    """Least distance of the true shapes of the robot from neighbours, on the whole way."""
    judge = Judge(CELL, [corners for one in parts for corners in one], ())
    return min(judge.clearances(q, tips_touch=False)["hand_object"] for q in script.targets[::2])


def test_what_stands_beside_is_not_touched_and_changes_the_plan(plans):
    alone, beside = (plan.found[0] for plan in plans)
    assert least(alone.script, SIDES) < 0.0  # or the scene shows nothing
    assert least(beside.script, SIDES) > 0.0
    assert not np.array_equal(alone.grasp.q, beside.grasp.q)
    again = Planner().plan(replace(ALONE, neighbours=()), SEED, HOME).found[0]
    assert np.array_equal(again.grasp.q, alone.grasp.q)


def test_among_neighbours_each_round_samples_more(monkeypatch):
    asked, none = [], Proposals.none("nothing")
    propose = "propose", lambda *given: asked.append(given[2].surface_points) or none
    monkeypatch.setattr(SurfaceProposals, *propose)
    for target in (ALONE, BESIDE):
        Search(Planner(), target, SEED, None).run()
    assert asked == [96] * 5 + [96, 192, 288, 288]


def test_approach_and_lift_through_a_neighbour_are_refused(plans):
    grasp, script = plans[0].found[0].grasp, plans[0].found[0].script
    palm = palm_frame(grasp.motion.pregrasp, TREE)[1]
    at_palm = replace(ALONE, neighbours=((box(*palm[:2], (0.06, 0.06, 0.06), palm[2] - 0.03),),))
    with pytest.raises(NoPath):
        make_script(HOME, grasp.motion, at_palm.everything, CELL)
    lid = replace(ALONE, neighbours=((box(0.5, 0.0, (0.04, 0.06, 0.04), 0.115),),))
    check_way(script, CELL, ALONE)
    with pytest.raises(NoPath, match="lift_blocked"):
        check_way(script, CELL, lid)
    lift = script.way("lift")
    assert carried_into(lid, lift, TREE) > 0.004
    assert carried_into(BESIDE, lift, TREE) == 0.0
    assert raised_into(lid, 0.14) > 0.01
    assert raised_into(BESIDE, 0.14) == 0.0
    refused = Planner().plan(lid, SEED, HOME)
    assert (refused.shortfall, refused.log.rounds) == ("lift_blocked", 0)  # no grasp is looked for


def test_a_hand_that_meets_a_neighbour_while_it_closes_is_refused(plans):
    grasp = plans[0].found[0].grasp
    (first, end), wide = TREE.fingers[1], grasp.motion.pregrasp.copy()
    wide[first + 1 : end] = TREE.lower[
        first + 1 : end
    ]  # so far that a post has room between finger and object
    between, index = fingertips(0.5 * (wide + grasp.q), TREE)[1], TREE.tip_body[1]
    post = replace(ALONE, neighbours=((box(*between[:2], (0.002, 0.002, 0.004), between[2]),),))
    problem = GraspProblem(post, CELL, PlannerSettings())
    assert not (too_near(wide, problem, 0.001)[:, 0] == NEIGHBOUR).any()
    assert overlap(grasp.q, problem) <= 0.0
    assert index in _in_the_way(wide, grasp.q, problem)[:, 1]
    moved = replace(grasp, motion=replace(grasp.motion, pregrasp=wide))
    for target, held in ((ALONE, True), (post, False)):
        found = verify(planned_record("box", moved, target, PlannerSettings()))
        assert all(check.holds == held for check in found if check.name.startswith("closing"))
    assert any(check.name == "closing: clearance hand_neighbour" for check in found)


def shell(x, y, size, seen=((1, 0), (-1, 0), (0, 1), (0, -1))):
    """Points and normals of the top and of the sides of a box that are seen."""
    grid = np.linspace(-0.5, 0.5, 15)
    u, v = (values.ravel() for values in np.meshgrid(grid, grid))
    faces = [(np.stack([u, v, 0 * u + 0.5], 1), (0, 0, 1))]
    for nx, ny in seen:
        side = np.stack([u if ny else 0 * u + 0.5 * nx, 0 * u + 0.5 * ny if ny else u, v], 1)
        faces.append((side, (nx, ny, 0)))
    points = np.concatenate([p for p, _ in faces]) * size + [x, y, 0.5 * size[2]]
    return ObjectCloud(points, np.concatenate([np.tile(n, (len(p), 1)).astype(float) for p, n in faces]))


def test_what_reaches_around_the_target_is_columns():
    ring = [
        shell(0.5 + x, y, np.array([0.02, 0.02, 0.1]))
        for x, y in product((-0.07, 0.0, 0.07), repeat=2)
        if x or y
    ]
    points = np.concatenate([one.points for one in ring])
    target = shell(0.5, 0.0, np.array([0.05, 0.05, 0.1]))
    (parts,) = neighbours_of(Scene(target, neighbours=(ObjectCloud(points, np.zeros_like(points)),)))
    assert len(parts) >= 8
    around = replace(ALONE, neighbours=(parts,)).around
    assert around.distance(points[points[:, 2] > 0.01]).max() < -SEEN + 1e-6
    assert around.distance([[0.5, 0.0, 0.05]])[0] > 0.04
    assert columns(np.zeros((0, 3))) == ()


def test_what_stands_in_the_way_is_set_aside_where_there_is_room():
    size = np.array([0.05, 0.05, 0.12])
    around = tuple(shell(0.5 + x, y, size) for x, y in [(0, 0.065), (0.06, 0), (0, -0.065)])
    far = shell(0.5, -0.3, size)
    scene = Scene(shell(0.5, 0.0, size * [1, 1, 0.5]), neighbours=(far, *around))
    target = replace(target_of(scene), neighbours=neighbours_of(scene))
    planner = Planner()
    aside = plan_rearrangement(planner, scene, target, SEED, HOME)
    taken = aside.target.centre
    assert np.linalg.norm(taken - far.points.mean(0)) > 0.1  # not in the way, and no higher
    assert len(aside.target.neighbours) == 4  # the others, and the object
    carry, lowering, leaving = (aside.script.phases[name] for name in ("carry", "set_down", "retreat"))
    (before, begin), (after, at) = (palm_frame(q, TREE) for q in (carry[0], lowering[-1]))
    turn = after @ before.T
    put = (turn @ (taken - begin) + at)[:2]
    assert np.linalg.norm(put - target.centre[:2]) > 0.15
    assert aside.target.around.distance(np.array([[*put, 0.06]]))[0] > 0.08
    assert palm_frame(leaving[-1], TREE)[1][2] > at[2] + 0.1
    assert plan_rearrangement(planner, replace(scene, neighbours=()), target, SEED, HOME) is None


@pytest.mark.parametrize("moves", [1, 0])
def test_an_agent_without_a_grasp_makes_way_or_pushes_and_lifts_after_all(monkeypatch, moves):
    agent, real = BilevelAgent(moves=moves, regrasps=1), bilevel.plan_scene

    def nothing(planner, scene, seed, start, neighbour_margin=0.0, **_):
        if not neighbour_margin:
            return PlanResult(target_of(scene))
        return real(planner, scene, seed, start, neighbour_margin=neighbour_margin)

    env = gym.make(
        "DexGrasp/ClutterHeap-v1",
        objects="soda",
        neighbour_objects="sugar_box",
        neighbours=1,
        gaps=(0.03, 0.03),
        mask="true",
        **agent.env_settings,
    )
    observation, info = env.reset(seed=0)
    for module in (bilevel, stages):
        monkeypatch.setattr(module, "plan_scene", nothing)
    agent.reset(observation, public_info(env, info))
    if moves:
        monkeypatch.undo()
    assert agent.report.failure
    assert agent.report.again
    info = finished(env, agent, observation, 2000)
    assert info["is_success"]
    assert agent.report.failure is None
    assert agent.result is None  # the object may have been shifted, or the plan lets neighbours be touched
    details = agent.report.details
    told = details.get("moves", 0), details.get("regrasps", 0), details.get("touching", 0.0)
    assert told == ((1, 0, 0.0) if moves else (0, 1, 0.01))
    assert info["is_clean"] == (not moves)
    assert (info["neighbours_moved"] > 0.1) == bool(moves)


LOW = np.array([TABLE_CENTRE_X, 0.0]) - 0.5 * np.array(TABLE_SIZE[:2])


def lying(size=(0.147, 0.071, 0.008), at=(0.5, 0.15), turn=0.6):
    return GraspTarget.of_corners([box(*at, size, turn=turn)], 0.18)


@pytest.fixture(scope="module")
def planned():
    planner, phone = Planner(cell=CELL), lying()
    slide = plan_slide(planner, phone, 0, HOME)
    assert slide is not None
    return planner, phone, slide


def test_pushes_leave_the_object_lying_and_sticking_out():
    phone = lying()
    found = pushes(phone, tips_apart(CELL), 0.014)
    assert found
    for push in found:
        there = phone.corners[:, :2] + push.distance * push.direction
        centre = phone.centre[:2] + push.distance * push.direction
        size = np.array(TABLE_SIZE[:2])
        assert max((LOW - there).max(), (there - LOW - size).max()) > 0.0215
        assert min((centre - LOW).min(), (LOW + size - centre).min()) > 0.0155
    assert not pushes(lying(size=(0.05, 0.05, 0.012)), tips_apart(CELL), 0.014)


def test_the_judge_knows_the_table_as_a_neighbour(planned):
    planner, phone, slide = planned
    slide.moved = slide.push.distance
    plan = plan_slid(planner, phone, slide, 0, HOME)
    assert plan.grasp is not None
    assert plan.grasp.certificate.load >= 1.0
    origin = Origin("bilevel", 0, 1.0)
    record = planned_record(
        "phone", plan.grasp, plan.target, plan.settings, script=plan.script, origin=origin
    )
    assert rejected(record) == []
    table = plan.target.neighbours[0][0]
    assert_allclose(np.ptp(table[:, :2], axis=0), TABLE_SIZE[:2])
    tips = fingertips(plan.grasp.q, robot_tree(plan.grasp.cell))
    assert tips[:, 2].min() < table[:, 2].max() + TREE.tip_radius  # lower than the table would let them be


def test_what_is_high_guessed_or_out_of_reach_is_not_pushed(planned):
    planner, phone, slide = planned
    assert plan_slide(planner, lying(size=(0.1, 0.06, 0.04)), 0, HOME) is None
    assert plan_slide(planner, slid(phone, np.zeros(2)), 0, HOME) is None
    far = Push(slide.push.direction, 3.0, slide.push.touch)
    with pytest.raises(Exception, match="push_out_of_reach"):
        make_slide(far, HOME, phone, CELL)


def test_the_agent_lifts_a_phone(tmp_path):
    path = tmp_path / "phone.obj"
    trimesh.creation.box((0.147, 0.071, 0.008)).export(path)
    env = gym.make(
        "DexGrasp/Lift-v2", objects=str(path), mesh_mass=0.18, **BilevelAgent.env_settings,
        disable_env_checker=True,
    )  # fmt: skip
    pose = [0.5, 0.15, 0.004, np.cos(0.3), 0.0, 0.0, np.sin(0.3)]
    observation, info = env.reset(seed=0, options={"object_pose": pose})
    agent = BilevelAgent()
    agent.seed(0)
    agent.reset(observation, public_info(env, info))
    assert isinstance(agent._stage.motion, Slide)
    assert agent.report.again
    assert finished(env, agent, observation)["is_success"]
    assert agent.report.failure is None
    assert agent.result is None  # the object is no longer where files would state it
    assert agent.report.details["slid"] > 0.1
