"""Requests: where contacts lie, which way the palm faces, which fingers; met by construction, and judged."""

import json
import pkgutil
import time
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from processes import typed
from refusals import refused, rejected
from tables import mistakes
from test_scene_cloud import box, table

from dexgrasp import plan_cloud
from dexgrasp.geometry.request import (
    APPROACH_WORDS,
    REGION,
    Demand,
    GraspRequest,
    relaxations,
)
from dexgrasp.grasp.file import record_of
from dexgrasp.grasp.verify.verify import verify
from dexgrasp.planning.asked_rows import with_request
from dexgrasp.planning.constraints import evaluate
from dexgrasp.planning.planner import Planner
from dexgrasp.planning.settings import GraspProblem, PlannerSettings
from dexgrasp.planning.sqp import bounds_of
from dexgrasp_env.poses import about_z, rigid
from dexgrasp_env.valid import check


def block(size=(0.05, 0.12, 0.09), middle=(0.52, 0.02), seed=0):
    """Return a cloud of a box on the table."""
    rng = np.random.default_rng(seed)
    return np.concatenate([table(rng), box(rng, middle, np.array(size))])


def judged(plan):
    """Return the checks of a planned grasp by name, from its file alone."""
    (content,) = plan.contents("block")
    return {check.name: check for check in verify(record_of(json.loads(json.dumps(content))))}


@pytest.mark.parametrize(
    "request_",
    [
        GraspRequest(hold=["box:0.4,0.03,0,0.6,0.12,0.12"]),
        GraspRequest(avoid=["box:0.4,-0.2,0,0.6,0.2,0.045"]),
        GraspRequest(hold=["sphere:0.52,0.02,0.09,0.06"]),
        GraspRequest(approach="side,40"),
        GraspRequest(approach="0.5,0,-1,25", fingers=("middle", "thumb", "index")),
    ],
    ids=["half", "above", "sphere", "side", "direction"],
)
def test_a_request_is_met_and_judged(request_):
    plan = plan_cloud(block(), seed=2, request=request_)
    assert plan.success, plan.relaxation
    checks = judged(plan)
    named = {"contacts outside the request", "palm direction", "fingers as requested"} & set(checks)
    assert named
    assert all(check.holds for check in checks.values())
    assert (request_.outside(plan.grasp.contacts) <= 0.0).all()
    problem = GraspProblem(plan.target, plan.grasp.cell, plan.settings)
    # Tips are hardly in, and other shapes far from, surface that is not to be touched.
    assert added(plan.grasp.q, problem)[0].min(initial=0.0) > -1e-4


def added(q, problem):
    """Return the rows of a request."""
    obstacle, bounds = problem.target.distance.obstacle, bounds_of(problem, 0.5)
    now = evaluate(q, problem.tree, obstacle, problem.world, bounds, problem.shape, True)
    asked = with_request(now, q, problem)
    return asked.values[len(now.values) :], asked.rows[len(now.values) :]


def test_what_is_asked_has_slopes_in_the_optimisation():
    asked = GraspRequest(hold=["box:0.4,0.03,0,0.6,0.12,0.12"], approach="0.3,0.2,-1,25")
    plan = plan_cloud(block(), seed=2)
    target = replace(plan.target, demand=Demand(asked, plan.grasp.cell.T_base_world))
    problem = GraspProblem(target, plan.grasp.cell, plan.settings)
    q, step = plan.grasp.q, 1e-6
    values, rows = added(q, problem)
    assert len(values) > 4
    slopes = [(added(q + step * way, problem)[0] - values) / step for way in np.eye(len(q))]
    assert np.allclose(rows, np.transpose(slopes), atol=1e-4)


def test_the_judge_refuses_a_grasp_that_is_not_as_asked():
    plan = plan_cloud(block(), seed=2)
    content = plan.contents("block")[0] | {"holds_probability": None}  # of a request there is none
    assert "request" not in content
    place = plan.grasp.contacts[0]
    beside = place + 0.006 * np.cross(plan.grasp.normals[0], [0, 0, 1])
    patch = "surface outside the request in the tips"
    asked = {"avoid": [{"points": [place.tolist()], "radius": 0.005}]}
    assert rejected(record_of(content | {"request": asked})) == ["contacts outside the request", patch]
    wrong = {
        patch: {"avoid": [{"points": [beside.tolist()], "radius": 0.004}]},
        "palm direction": {"approach": {"direction": [0, 0, 1], "degrees": 20.0, "name": ""}},
        "fingers as requested": {"fingers": ["thumb", "index"]},
    }
    for name, asked in wrong.items():
        assert rejected(record_of(content | {"request": asked})) == [name]
    for asked in mistakes("requests_in_files"):
        with refused(r"request|region|approach"):
            record_of(content | {"request": asked})


def test_what_cannot_be_had_is_said_with_the_nearest_that_can():
    low = plan_cloud(block((0.06, 0.07, 0.05)), seed=1, request=GraspRequest(approach="0,0,1,20"))
    assert not low.success
    assert "none whose palm faces along 0.00 0.00 1.00 within 20 degrees; one at" in low.relaxation
    beside = GraspRequest(hold=["box:0.5,0.2,0,0.6,0.3,0.2"], approach="top")
    none = plan_cloud(block(), seed=1, request=beside)
    assert none.reason == "no_grasp:no_surface_as_requested"
    assert "is to be held; one whose tips miss it by" in none.relaxation


@pytest.mark.parametrize("most", [3.0, 8.0])
def test_fingers_press_no_harder_than_is_asked(most):
    free, gentle = (
        plan_cloud(block(), seed=2, request=GraspRequest(mass=0.15, max_force=force))
        for force in (None, most)
    )
    checks = judged(gentle)
    assert checks["pressing force"].value <= most + 1e-4
    assert gentle.grasp.certificate.holds
    assert all(check.holds for check in checks.values())
    content = free.contents("block")[0] | {"holds_probability": None}
    assert checks["mass off the request's"].holds
    assert rejected(record_of(content | {"request": {"max_force": most}})) == ["pressing force"]


def test_too_gentle_is_said():
    hasty = Planner(PlannerSettings(patience=0))
    heavy = plan_cloud(block(), seed=2, planner=hasty, request=GraspRequest(mass=0.6, max_force=3.0))
    assert not heavy.success or not heavy.grasp.certificate.holds
    assert heavy.relaxation.startswith("none with at most 3 N a finger; one with ")
    with refused("start is"):
        hasty.plan(heavy.target, start=np.zeros(22))
    for wrong, words in mistakes("clouds"):
        with refused(words):
            plan_cloud(block(), **wrong)


def test_a_budget_ends_the_search_with_what_it_has():
    began = time.perf_counter()
    none = plan_cloud(block(), seed=2, request=GraspRequest(seconds=1e-4))
    assert (none.reason, none.relaxation) == ("no_grasp:time_budget", "")
    assert plan_cloud(block(), seed=2, request=GraspRequest(seconds=30.0)).success
    assert time.perf_counter() - began < 30.0


def test_a_mask_of_the_faces_of_a_mesh_is_a_region(tmp_path, capsys, printed):
    mesh = trimesh.creation.box((0.05, 0.12, 0.09)).subdivide().subdivide()
    mesh.export(tmp_path / "block.ply")
    np.save(tmp_path / "faces.npy", mesh.triangles_center[:, 1] > 0.0)
    command = f"plan {tmp_path / 'block.ply'} --hold mask:{tmp_path / 'faces.npy'} --json"
    assert typed(command) == 0
    grasp = printed()["grasp"]
    T = np.linalg.inv(grasp["T_world_object"])
    points = np.array([contact["point"] for contact in grasp["contacts"]])
    assert ((points @ T[:3, :3].T + T[:3, 3])[:, 1] > -0.01).all()
    np.save(tmp_path / "faces.npy", np.ones(7, bool))
    assert typed(command) == 2
    assert f"valid is one for each of {len(mesh.faces)} faces" in capsys.readouterr().err


def test_regions_and_ways_in_words():
    cube, ball = (check("region", text, REGION) for text in ("box:0,0,0,1,2,3", "sphere:0,0,1,0.5"))
    assert np.allclose(cube.gap(np.array([[0.5, 1, 1], [2, 1, 1], [2, 3, 1]])), [-0.5, 1.0, np.sqrt(2)])
    assert np.allclose(cube.grown(0.25).gap(np.array([[1.5, 1.0, 1.0]])), [0.25])
    assert np.allclose(ball.gap(np.array([[0, 0, 1], [0, 0, 2]])), [-0.5, 0.5])
    side = check("approach", "side,10", APPROACH_WORDS)
    assert np.allclose(side.off(np.array([[1, 0, 0], [0, 0, -1], [0, 1, 1] / np.sqrt(2)])), [0, 90, 45])
    for name, rule in (("hold", REGION), ("approach", APPROACH_WORDS)):
        for text in mistakes(name):
            with refused(f"{name} is|{name}|region"):
                check(name, text, rule)


def test_a_request_is_of_the_frame_of_the_base_wherever_the_world_is():
    T = rigid(about_z(0.7), np.array([0.1, -0.2, 0.3]))
    request = GraspRequest(hold=["box:0,0,0,1,1,1"], approach="1,0,0")
    demand = Demand(request, T)
    inside = np.linalg.inv(T) @ [0.5, 0.5, 0.5, 1.0]
    assert np.allclose(demand.outside(inside[None, :3]), -0.5)
    assert np.allclose(demand.off((T[:3, :3].T @ [1.0, 0.0, 0.0])[None]), 0.0, atol=1e-5)
    assert relaxations(request).keys() == {"hold", "approach"}
    assert relaxations(
        GraspRequest(hold=["sphere:5,0,0,1"], max_force=1000.0)
    )  # at the edge of what is valid


def test_the_command_takes_it(tmp_path, capsys, printed):
    points = block()
    np.save(tmp_path / "scene.npy", points)
    np.save(tmp_path / "mask.npy", points[:, 1] > 0.03)
    base = f"plan --cloud {tmp_path / 'scene.npy'} --seed 2"
    assert typed(f"{base} --hold mask:{tmp_path / 'mask.npy'} --approach top,60 --json") == 0
    grasp = printed()["grasp"]
    assert all(contact["point"][1] > 0.02 for contact in grasp["contacts"])
    assert grasp["request"]["approach"]["degrees"] == 60.0
    for options, words in mistakes("request_words"):
        assert typed(f"{base} {options}") == 2, options
        assert words in capsys.readouterr().err
    assert typed(f"plan pear --hold mask:{tmp_path / 'mask.npy'}") == 2
    assert "of the faces of a mesh file" in capsys.readouterr().err


def test_what_is_known_of_the_object_is_of_the_request_and_judged():
    plan = plan_cloud(block(), seed=2, request=GraspRequest(friction=0.7, mass=0.2, min_probability=0.5))
    assert all(check.holds for check in judged(plan).values())
    assert plan.grasp.certificate.mass == 0.2
    (content,) = plan.contents("block")
    for asked, name in mistakes("known_otherwise"):
        assert rejected(record_of(content | {"request": asked})) == [name]
    sure = plan_cloud(block(), seed=2, request=GraspRequest(min_probability=0.9999))
    assert sure.reason == "no_grasp:not_sure_enough"
    assert sure.relaxation.startswith("none held with probability 0.9999; one with 0.")


@pytest.mark.parametrize(("name", "wrong"), mistakes("calls"))
def test_what_programs_call_refuses_what_is_of_another_kind(name, wrong):
    with refused(f"{[*wrong][-1]} is .*: valid is"):
        pkgutil.resolve_name(name)(**wrong)


@pytest.mark.parametrize("wrong", mistakes("request_settings"))
def test_nonsense_in_python_is_refused_as_elsewhere(wrong):
    (name,) = wrong
    with refused(f"{name} is .*: valid is"):
        GraspRequest(**wrong)
