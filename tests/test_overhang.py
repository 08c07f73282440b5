"""What lies flat: pushed over the table's edge, and grasped where it sticks out."""

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
from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.planned_record import Origin, planned_record
from dexgrasp.mechanics.kinematics.forward import fingertips
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.motion.slide import Push, Slide, make_slide, tips_apart
from dexgrasp.planning.overhang import plan_slid, plan_slide, pushes, slid
from dexgrasp.planning.planner import Planner
from dexgrasp_env.scene.constants import TABLE_CENTRE_X, TABLE_SIZE

START, TREE = np.array(HOME), robot_tree(CELL)
LOW = np.array([TABLE_CENTRE_X, 0.0]) - 0.5 * np.array(TABLE_SIZE[:2])


def lying(size=(0.147, 0.071, 0.008), at=(0.5, 0.15), turn=0.6):
    corners = np.array(list(product(*[(-0.5 * s, 0.5 * s) for s in size])))
    c, s = np.cos(turn), np.sin(turn)
    return GraspTarget.of_corners([corners @ [[c, s, 0], [-s, c, 0], [0, 0, 1]] + [*at, 0.5 * size[2]]], 0.18)


@pytest.fixture(scope="module")
def planned():
    planner, phone = Planner(cell=CELL), lying()
    slide = plan_slide(planner, phone, 0, START)
    assert slide is not None
    return planner, phone, slide


def test_pushes_leave_the_object_lying_and_sticking_out():
    phone = lying()
    found = pushes(phone, tips_apart(CELL), 0.014)
    assert found
    for push in found:
        there = np.concatenate(phone.corners)[:, :2] + push.distance * push.direction
        centre = phone.centre[:2] + push.distance * push.direction
        size = np.array(TABLE_SIZE[:2])
        assert max((LOW - there).max(), (there - LOW - size).max()) > 0.0215
        assert min((centre - LOW).min(), (LOW + size - centre).min()) > 0.0155
    assert not pushes(lying(size=(0.05, 0.05, 0.012)), tips_apart(CELL), 0.014)


def test_the_judge_knows_the_table_as_a_neighbour(planned):
    planner, phone, slide = planned
    slide.moved = slide.push.distance
    plan = plan_slid(planner, phone, slide, 0, START)
    assert plan.grasp is not None
    assert plan.grasp.certificate.load >= 1.0
    origin = Origin("bilevel", 0, 1.0)
    record = planned_record(
        "phone", plan.grasp, plan.target, plan.settings, script=plan.script, origin=origin
    )
    failed = rejected(record)
    assert failed == []
    table = plan.target.neighbours[0][0]
    assert_allclose(np.ptp(table[:, :2], axis=0), TABLE_SIZE[:2])
    tips = fingertips(plan.grasp.q, robot_tree(plan.grasp.cell))
    assert tips[:, 2].min() < table[:, 2].max() + TREE.tip_radius  # lower than the table would let them be


def test_what_is_high_guessed_or_out_of_reach_is_not_pushed(planned):
    planner, phone, slide = planned
    assert plan_slide(planner, lying(size=(0.1, 0.06, 0.04)), 0, START) is None
    crowded = slid(phone, np.zeros(2))
    assert plan_slide(planner, crowded, 0, START) is None
    far = Push(slide.push.direction, 3.0, slide.push.touch)
    with pytest.raises(Exception, match="push_out_of_reach"):
        make_slide(far, START, phone, CELL)


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
