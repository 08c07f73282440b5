"""Certificates confirmed by `verify`; thresholds, planned friction."""

import ast
import copy
from pathlib import Path

import numpy as np
import pytest
from planned import MESHES, SETTINGS, failing
from processes import python
from robots import LOWER, UPPER

from dexgrasp.geometry.request import GraspRequest
from dexgrasp.grasp.thresholds import planned_friction
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp_env.objects.catalogue import CATALOGUE


@pytest.mark.parametrize("name", MESHES)
def test_every_check_of_a_planned_grasp_holds(name, contents, check):
    checks = check(contents[name])
    assert failing(checks) == set()
    assert len(checks) == (90 if name in CATALOGUE else 79)
    claimed = contents[name]["certificate"]
    least = min(checks[f"clearance {kind}"].value for kind in ("hand_object", "hand_table"))
    # The planner's spheres cover the true shapes: it never claims more room than there is.
    assert SETTINGS.clearance - 1e-6 <= claimed["min_clearance_m"] <= least + 2e-5
    assert SETTINGS.clearance <= checks["clearance self"].value
    assert claimed["closure_margin"] == pytest.approx(checks["closure margin, exact cone"].value, abs=1e-5)
    assert claimed["load"] >= 1.0
    assert claimed["capacity"] >= 1.0
    assert claimed["load"] == pytest.approx(checks["load"].value, rel=1e-4)
    assert claimed["max_joint_torque_fraction"] == pytest.approx(
        checks["joint torque over limit"].value, abs=1e-6
    )
    q = np.array(contents[name]["q"])
    assert claimed["joint_limit_margin_rad"] == pytest.approx(
        np.minimum(q - LOWER, UPPER - q).min(), abs=1e-9
    )
    assert claimed["closure_residual"] < 1e-6
    assert claimed["force_ratio_percent"] < 0.1
    assert claimed["torque_ratio_percent"] < 0.1
    assert claimed["holds"] is True


def test_a_grasp_without_a_way_to_it_is_not_verified(contents, check):
    content = contents["pear"] | {"script": None}
    assert failing(check(content)) == {"approach given", "lift given"}


SHARED = {
    "geometry.mesh_distance", "geometry.request", "grasp.identity", "grasp.trajectory", "grasp.probability",
    "grasp.record", "grasp.thresholds",
}  # fmt: skip
"""All of the library that the judge imports, also within functions."""


def test_the_judge_shares_what_the_docs_say_and_no_more():
    root = Path(__file__).parents[1]
    nodes = [
        n
        for file in (root / "dexgrasp" / "grasp" / "verify").rglob("*.py")
        for n in ast.walk(ast.parse(file.read_text()))
    ]
    names = {n.module for n in nodes if isinstance(n, ast.ImportFrom)}
    names |= {alias.name for n in nodes if isinstance(n, ast.Import) for alias in n.names}
    ours = {name.removeprefix("dexgrasp.") for name in names if name.startswith("dexgrasp.")}
    assert {name for name in ours if not name.startswith("grasp.verify")} == SHARED
    text = (root / "docs" / "concepts.md").read_text()
    assert [name for name in SHARED if f"`dexgrasp.{name}`" not in text] == []
    code = "import sys, dexgrasp.grasp.verify.verify; print(*sys.modules)"
    loaded = [
        m
        for m in python(code).split()
        if not m.startswith(("dexgrasp.mechanics.kinematics", "dexgrasp.mechanics.contact_models"))
    ]
    assert [
        m for m in loaded if m.startswith(("dexgrasp.planning", "dexgrasp.mechanics.", "dexgrasp.registry"))
    ] == []


def test_planned_friction_is_a_share_of_the_true_one_and_never_more_than_frozen():
    assert planned_friction(0.7) == pytest.approx((0.5, 0.6))
    assert planned_friction(2.0) == (0.5, 0.6)
    assert planned_friction(0.35) == pytest.approx((0.25, 0.3))
    settings = PlannerSettings().asked(GraspRequest(friction=0.35))
    assert (settings.friction, settings.friction_hold) == pytest.approx((0.25, 0.3))


def test_thresholds_do_not_move_with_the_planners_defaults(contents, check):
    content = copy.deepcopy(contents["pear"])
    content["thresholds"]["clearance"] = 0.002
    assert "thresholds as frozen" in failing(check(content))
    content["thresholds"]["clearance"] = 0.0005
    assert "thresholds looser than ours" in failing(check(content))
