"""Certificates confirmed by `verify`, tampered grasps caught by the right check, grasp files read safely."""

import copy
import json

import numpy as np
import pytest
import trimesh

from agents.grasp.file import grasp_json, read_grasp, write_grasp
from agents.grasp.target import GraspTarget
from agents.grasp.verify import verify
from agents.kinematics.tree import robot_tree
from agents.planning.planner import Planner
from agents.planning.settings import PlannerSettings
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.load import load_object
from dexgrasp_env.robot.limits import LOWER, UPPER

TREE, SETTINGS = robot_tree(), PlannerSettings()


def catalogue(name):
    mesh = load_object(name).mesh.copy()
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.5, [0, 0, 1]))
    low, high = mesh.bounds
    mesh.apply_translation([0.48 - (low + high)[0] / 2, 0.05 - (low + high)[1] / 2, -low[2]])
    return mesh


def users_mesh():
    """A mug without its handle's charm: not convex, off centre."""
    cup = trimesh.creation.annulus(0.026, 0.032, 0.09)
    handle = trimesh.creation.box((0.03, 0.01, 0.05))
    handle.apply_translation([0.04, 0, 0])
    mesh = trimesh.util.concatenate([cup, handle])
    mesh.apply_translation([0.5, -0.05, -mesh.bounds[0, 2]])
    return mesh


MESHES = {
    "sugar_box": catalogue, "pear": catalogue, "tomato_soup_can": catalogue, "tetrahedron": catalogue,
    "massage_ball": catalogue, "users_mesh": lambda name: users_mesh(),
}  # fmt: skip


@pytest.fixture(scope="module")
def contents():
    found = {}
    for seed, (name, make) in enumerate(MESHES.items()):
        grasp_target = GraspTarget.of(make(name), mass=0.2)
        plan = Planner().plan(grasp_target, seed)
        assert plan.grasp is not None, (name, plan.reason)
        found[name] = grasp_json(name, plan.grasp, grasp_target, SETTINGS)
    return found


@pytest.fixture
def check(tmp_path):
    def run(content):
        path = tmp_path / "grasp.json"
        write_grasp(path, content)
        return {c.name: c for c in verify(read_grasp(path))}

    return run


def failing(checks):
    return {name for name, c in checks.items() if not c.holds}


def test_a_file_cannot_lower_the_bar_it_is_held_to(contents, check):
    loosened = json.loads(json.dumps(contents["sugar_box"]))
    loosened["thresholds"]["closure_margin"] = 0.0
    assert "thresholds looser than ours" in failing(check(loosened))


@pytest.mark.parametrize("name", MESHES)
def test_every_check_of_a_planned_grasp_holds(name, contents, check):
    checks = check(contents[name])
    assert failing(checks) == set()
    assert len(checks) == 28
    claimed = contents[name]["certificate"]
    least = min(checks[f"clearance {kind}"].value for kind in ("hand_object", "hand_table"))
    # The planner's spheres cover the true shapes: it never claims more room than there is.
    assert SETTINGS.clearance - 1e-6 <= claimed["min_clearance_m"] <= least + 2e-5
    assert SETTINGS.clearance <= checks["clearance self"].value
    assert claimed["closure_margin"] == pytest.approx(checks["closure margin, exact cone"].value, abs=1e-5)
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


def shift_joints(c):
    c["q"] = (np.array(c["q"]) + 0.02 * np.r_[np.zeros(7), np.ones(16)]).tolist()


def shift_arm(c):
    c["q"][1] += 0.02


def double_forces(c):
    c["forces"] = (2 * np.array(c["forces"])).tolist()


def weaken_forces(c):
    c["forces"] = (0.5 * np.array(c["forces"])).tolist()


def slide_forces(c):
    n = np.array(c["normals"])
    c["forces"] = (np.array(c["forces"]) + 30 * np.cross(n, [0.1, 0.2, 0.97])).tolist()


def pull(c):
    c["forces"] = (-np.array(c["forces"])).tolist()


def crush(c):
    """Add a balanced squeeze that no joint can press with."""
    n, p = np.array(c["normals"]), np.array(c["contacts"])
    inward = p.mean(0) - p
    inward -= inward.mean(0)
    c["forces"] = (np.array(c["forces"]) + 3000 * inward).tolist()
    assert n.shape == (3, 3)


def move_contacts(c):
    c["contacts"] = (np.array(c["contacts"]) + np.array([0.005, 0, 0])).tolist()


def turn_normals(c):
    c["normals"] = np.roll(np.array(c["normals"]), 1, axis=0).tolist()


def raise_margin(c):
    c["certificate"]["closure_margin"] += 0.1


def claim_distances(c):
    c["certificate"]["distances_cm"][1] += 0.05


def claim_room(c):
    c["certificate"]["min_clearance_m"] += 0.01


def claim_strength(c):
    c["certificate"]["max_joint_torque_fraction"] *= 0.9


def claim_range(c):
    c["certificate"]["joint_limit_margin_rad"] += 0.01


def shift_hull(c):
    c["hull_vertices"] = (np.array(c["hull_vertices"]) + np.array([0, 0.006, 0])).tolist()


def grow_hull(c):
    v = np.array(c["hull_vertices"])
    c["hull_vertices"] = (v.mean(0) + 1.3 * (v - v.mean(0))).tolist()


def sink(c):
    """Everything 10 cm lower, as a hull that goes through the table: the hand meets the table's other side."""
    c["q"][1] += 0.25


def open_wide(c):
    c["pregrasp"] = list(c["q"])


def break_limit(c):
    c["squeeze"][8] = UPPER[8] + 0.01


def heavier(c):
    c["mass"] += 0.1


def off_centre(c):
    c["centre"][0] += 0.03


def slippery(c):
    c["thresholds"]["friction"] = 0.01


def cross_fingers(c):
    """Index and middle base turned towards each other: their links overlap."""
    c["q"][7], c["q"][11] = LOWER[7], UPPER[11]


@pytest.mark.parametrize(
    ("tamper", "expected"),
    [
        (shift_joints, {"contacts as claimed", "distances as claimed"}),
        (shift_arm, {"contacts as claimed"}),
        (double_forces, {"forces balance gravity"}),
        (weaken_forces, {"forces balance gravity"}),
        (slide_forces, {"share of friction used"}),
        (pull, {"least pressing force", "forces balance gravity"}),
        (crush, {"joint torque over limit"}),
        (move_contacts, {"contacts as claimed"}),
        (turn_normals, {"normals as claimed"}),
        (raise_margin, {"closure margin as claimed"}),
        (claim_distances, {"distances as claimed"}),
        (shift_hull, {"contacts as claimed"}),
        (grow_hull, {"distance:thumb", "distance:index", "distance:middle"}),
        (sink, {"clearance hand_table"}),
        (open_wide, {"pregrasp clearance hand_object"}),
        (break_limit, {"joint limits:squeeze"}),
        (heavier, {"forces balance gravity"}),
        (off_centre, {"torques balance gravity"}),
        (slippery, {"closure margin as claimed"}),
        (claim_room, {"least clearance over the true one"}),
        (claim_strength, {"joint torque as claimed"}),
        (claim_range, {"joint limit margin as claimed"}),
        (cross_fingers, {"clearance self"}),
    ],
)
@pytest.mark.parametrize("name", ["sugar_box", "pear"])
def test_tampered_grasps_fail_with_the_right_check(tamper, expected, name, contents, check):
    content = copy.deepcopy(contents[name])
    tamper(content)
    broken = failing(check(content))
    assert expected <= broken, broken


def test_only_what_was_tampered_with_fails(contents, check):
    for tamper, expected in (
        (raise_margin, {"closure margin as claimed"}),
        (move_contacts, {"contacts as claimed"}),
        (claim_distances, {"distances as claimed"}),
        (heavier, {"forces balance gravity"}),
        (break_limit, {"joint limits:squeeze"}),
        (claim_room, {"least clearance over the true one"}),
        (claim_strength, {"joint torque as claimed"}),
        (claim_range, {"joint limit margin as claimed"}),
    ):
        content = copy.deepcopy(contents["sugar_box"])
        tamper(content)
        assert failing(check(content)) == expected


def test_small_shifts_of_every_joint_that_bears_a_grasping_tip_are_seen(contents, check):
    for joint in (*range(7), *range(7, 15), *range(19, 23)):
        content = copy.deepcopy(contents["pear"])
        content["q"][joint] += 0.01
        assert "contacts as claimed" in failing(check(content)), joint


# Grasp files


def test_round_trip(contents, tmp_path):
    content = contents["pear"]
    write_grasp(tmp_path / "g.json", content)
    record = read_grasp(tmp_path / "g.json")
    for name in ("q", "pregrasp", "grasp", "squeeze", "contacts", "normals", "forces", "centre"):
        np.testing.assert_array_equal(record.arrays[name], content[name])
    np.testing.assert_array_equal(record.hull, content["hull_vertices"])
    assert record.object == "pear"
    assert record.mount == "palm_normal"
    assert record.mass == content["mass"]
    assert record.settings.distance == SETTINGS.distance
    assert record.settings.friction == SETTINGS.friction
    assert record.certificate == content["certificate"]
    assert json.loads((tmp_path / "g.json").read_text()) == content
    write_grasp(tmp_path / "whole.json", {"schema": 1, "grasp": content})  # the output of `plan --json`
    np.testing.assert_array_equal(read_grasp(tmp_path / "whole.json").arrays["q"], record.arrays["q"])


def drop(key):
    return lambda c: c.pop(key)


def put(key, value, *inner):
    def change(c):
        target = c
        for k in inner:
            target = target[k]
        target[key] = value

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (put("schema", 2), "schema 1"),
        (drop("schema"), "schema 1"),
        (drop("q"), "q"),
        (drop("thresholds"), "thresholds"),
        (drop("hull_vertices"), "hull_vertices"),
        (put("q", [0.0] * 22), r"q must be .*\(23,\)"),
        (put("q", ["a"] * 23), "grasp"),
        (put("q", None), "q must be"),
        (put("forces", [[0.0, 0.0, 1.0]] * 2), r"forces must be .*\(3, 3\)"),
        (put("forces", [[0, 0, float("nan")]] * 3), "forces must be finite"),
        (put("squeeze", [float("inf")] * 23), "squeeze must be finite"),
        (put("hull_vertices", [[0, 0, 0]] * 3), "V >= 4"),
        (put("hull_vertices", [[0.0, 0.0, float("nan")]] * 8), "hull_vertices"),
        (put("hull_vertices", [[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0], [0.1, 0.1, 0]]), "hull"),
        (put("mount", "sideways"), "palm_normal"),
        (put("mass", "heavy"), "grasp"),
        (put("mass", float("nan")), "mass"),
        (put("mass", -1.0), "mass"),
        (put("distance", [0.0, 0.0, 0.0], "thresholds"), "distance"),
        (put("friction", float("nan"), "thresholds"), "friction"),
        (put("friction", -0.5, "thresholds"), "friction"),
        (put("certificate", {}), "distances_cm"),
        (put("certificate", None), "grasp"),
        (put("distances_cm", [0.1, 0.2], "certificate"), "distances_cm"),
        (put("distances_cm", ["a", "b", "c"], "certificate"), "grasp"),
        (put("closure_margin", None, "certificate"), "closure_margin"),
        (put("min_clearance_m", "much", "certificate"), "grasp"),
        (put("T_world_object", [[1.0]]), "T_world_object"),
    ],
)
def test_malformed_files_are_one_line(change, words, contents, tmp_path):
    content = copy.deepcopy(contents["pear"])
    change(content)
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=words) as caught:
        verify(read_grasp(path))
    assert "\n" not in str(caught.value)
    assert "bad.json" in str(caught.value)


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "3", "null", '{"schema": 1}', '{"schema": 1, "grasp": null}', "\udcff"]
)
def test_files_that_are_no_grasps(text, tmp_path):
    path = tmp_path / "bad.json"
    path.write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(InputError) as caught:
        read_grasp(path)
    assert "\n" not in str(caught.value)


def test_truncated_missing_and_folder(contents, tmp_path):
    path = tmp_path / "cut.json"
    path.write_text(json.dumps(contents["pear"])[:2000])
    with pytest.raises(InputError, match="cut off"):
        read_grasp(path)
    with pytest.raises(InputError, match="cannot read"):
        read_grasp(tmp_path / "nowhere.json")
    with pytest.raises(InputError, match="cannot read"):
        read_grasp(tmp_path)
