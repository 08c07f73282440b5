"""Many grasps of one scene: certified, different, firmest first, reproducible; a shortfall has a reason."""

import json

import numpy as np
import pytest
from planned import lying
from processes import typed
from refusals import refused, rejected
from robots import HOME
from test_scene_cloud import scene_points

from dexgrasp.cli.codes import ANSWER_IS_NO, OK
from dexgrasp.geometry.request import MOST, GraspRequest
from dexgrasp.grasp.diversity import hand_points
from dexgrasp.grasp.planned_record import Origin, planned_record
from dexgrasp.planning.diverse import plan_many
from dexgrasp.planning.plan_scene import plan_cloud
from dexgrasp.planning.planner import Planner

COUNT = 6


def box(x=0.5):
    return lying((0.05, 0.07, 0.08), (x, 0.0), 0.2)


@pytest.fixture(scope="module")
def found():
    steps = []
    planner, target = Planner().asking(GraspRequest(count=COUNT)), box()
    return (
        planner,
        target,
        plan_many(planner, target, 3, HOME, lambda *step: steps.append(step)),
        steps,
    )


def test_every_grasp_is_verified_and_bears_the_weight(found):
    planner, target, grasps, _ = found
    assert len(grasps.found) == COUNT
    assert grasps.reason is None
    for plan in grasps.found:
        assert plan.grasp.certificate.load >= 1.0
        record = planned_record(
            "box", plan.grasp, target, planner.settings, script=plan.script, origin=Origin("bilevel")
        )
        assert rejected(record) == []


def test_firmest_first_and_progress_to_the_end(found):
    _, _, grasps, steps = found
    loads = [plan.grasp.certificate.load for plan in grasps.found]
    assert loads == sorted(loads, reverse=True)
    done, of = zip(*steps, strict=True)
    assert list(done) == sorted(done)
    assert done[-1] == of[-1] == 5 * COUNT


def test_grasps_stand_farther_apart_than_those_that_come_first(found):
    planner, target, grasps, _ = found
    chosen = _least_gap(planner, [plan.grasp for plan in grasps.found])
    first = [Planner().plan(target, seed, HOME).grasp for seed in range(COUNT)]
    assert chosen > 0.02
    assert chosen > _least_gap(planner, first)
    assert 0.0 < grasps.diversity[0] < 1.0
    assert grasps.per_second > 0.0


def _least_gap(planner, grasps):
    """Smallest root mean square distance, m, of two hands."""
    points = [hand_points(g.q, g.contacts, planner.tree) for g in grasps]
    return min(np.sqrt(((a - b) ** 2).sum(1).mean()) for k, a in enumerate(points) for b in points[:k])


def test_the_same_seed_gives_the_same_set(found):
    planner, target, grasps, _ = found
    again = plan_many(planner, target, 3, HOME)
    assert all((a.grasp.q == b.grasp.q).all() for a, b in zip(grasps.found, again.found, strict=True))


def test_out_of_reach_ends_with_a_reason():
    grasps = plan_many(Planner().asking(GraspRequest(count=3)), box(x=1.4), 0, HOME)
    assert grasps.found == []
    assert grasps.reason == "no_grasp:no_reachable_posture"
    assert grasps.diversity == []


@pytest.mark.parametrize("count", [0, -1, 2.0, True, MOST + 1])
def test_a_bad_count_is_refused(count):
    with refused("a whole number from 1 to 10000"):
        GraspRequest(count=count)


def test_the_command_writes_files_a_table_and_json(tmp_path, capsys):
    (tmp_path / "grasp_009.json").write_text("{}")
    assert typed(f"plan pear --count 3 --seed 1 --out {tmp_path} --json") == OK
    out, err = capsys.readouterr()
    result = json.loads(out)
    assert result["success"] is True
    assert result["count"] == result["asked"] == len(result["grasps"]) == 3
    assert result["certificate"]["load"] == max(g["certificate"]["load"] for g in result["grasps"])
    assert "1 grasp files there are of an earlier run" in err
    for k in range(3):
        path = tmp_path / f"grasp_{k:03d}.json"
        assert json.loads(path.read_text())["q"] == result["grasps"][k]["q"]
        assert typed(f"verify {path}") == OK
    capsys.readouterr()
    assert typed("plan pear --count 3 --seed 1") == OK
    assert "pear: 3 of 3 grasps" in capsys.readouterr().out


def test_too_few_from_a_cloud_say_so_and_end_in_no(tmp_path, capsys):
    points = scene_points(np.random.default_rng(0), (0.5, 0.0))
    found = plan_cloud(points, request=GraspRequest(count=2))
    assert len(found.grasps) == len(found.as_json("box")["grasps"]) == 2
    assert found.grasps[0].certificate.load >= found.grasps[1].certificate.load
    np.save(tmp_path / "far.npy", points + np.array([0.9, 0.0, 0.0]))
    assert typed(f"plan --cloud {tmp_path / 'far.npy'} --count 2") == ANSWER_IS_NO
    assert "0 of 2 grasps" in capsys.readouterr().out
