"""Certificates confirmed by `verify`, tampered grasps caught by the right check, grasp files read safely."""

import copy
import json

import numpy as np
import pytest
import trimesh

from agents.grasp.file import ObjectPose, grasp_json, read_grasp, record_of, write_grasp
from agents.grasp.identity import ObjectIdentity
from agents.grasp.target import GraspTarget
from agents.grasp.thresholds import FROZEN, planned_friction
from agents.grasp.verify import unchecked, verify
from agents.planning.planner import Planner
from agents.planning.settings import PlannerSettings
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.catalogue import CATALOGUE
from dexgrasp_env.objects.load import load_object
from dexgrasp_env.robot.limits import HOME, LOWER, UPPER

SETTINGS = PlannerSettings()
PLACED = {}


def catalogue(name):
    mesh = load_object(name).mesh.copy()
    turn = trimesh.transformations.rotation_matrix(0.5, [0, 0, 1])
    mesh.apply_transform(turn)
    low, high = mesh.bounds
    shift = [0.48 - (low + high)[0] / 2, 0.05 - (low + high)[1] / 2, -low[2]]
    mesh.apply_translation(shift)
    PLACED[name] = trimesh.transformations.translation_matrix(shift) @ turn
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
        plan = Planner().plan(grasp_target, seed, HOME)
        assert plan.grasp is not None, (name, plan.reason)
        identity, pose = name, None
        if name in CATALOGUE:
            identity = ObjectIdentity.of(load_object(name), name)
            pose = ObjectPose(load_object(name).mesh, PLACED[name])
        found[name] = grasp_json(
            identity,
            plan.grasp,
            grasp_target,
            SETTINGS,
            script=plan.script,
            pose=pose,
            agent="bilevel",
            seed=seed,
        )
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
    checks = check(loosened)
    assert "thresholds looser than ours" in failing(checks)
    assert checks["thresholds looser than ours"].bound == "closure_margin"


@pytest.mark.parametrize("name", MESHES)
def test_every_check_of_a_planned_grasp_holds(name, contents, check):
    checks = check(contents[name])
    assert failing(checks) == set()
    assert len(checks) == (84 if name in CATALOGUE else 78)
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
    c["certificate"]["mass"] += 0.1


def off_centre(c):
    c["centre"][0] += 0.03


def slippery(c):
    c["thresholds"]["friction"] = 0.01


def cross_fingers(c):
    """Index and middle base turned towards each other: their links overlap."""
    c["q"][7], c["q"][11] = LOWER[7], UPPER[11]


def no_press(c):
    c["squeeze"] = list(c["grasp"])


def hand_alike(c):
    for name in ("pregrasp", "grasp", "squeeze"):
        c[name][7:] = [0.3] * 16


def never_opens(c):
    c["grasp"] = list(c["pregrasp"])


def stays_home(c):
    c["pregrasp"] = HOME.tolist()
    c["approach"]["setpoints"] = [HOME.tolist() for _ in c["approach"]["times"]]


def strays(c):
    for row in c["lift"]["setpoints"][5:]:
        row[0] += 0.1


def twitches(c):
    c["approach"]["setpoints"][10][3] += 0.01


def through_the_object(c):
    ends = np.array(c["approach"]["setpoints"])
    c["approach"]["setpoints"] = np.linspace(ends[0], c["q"], len(ends)).tolist()


def hurries(c):
    c["approach"] = c["approach"] | {
        "times": c["approach"]["times"][::4], "setpoints": c["approach"]["setpoints"][::4],
    }  # fmt: skip


def lighter(c):
    c["object"]["known_mass"] = None
    c["certificate"]["mass"] *= 0.001
    c["forces"] = (0.001 * np.array(c["forces"])).tolist()


def elsewhere(c):
    c["T_world_object"][0][3] += 0.1


def other_object(c):
    c["object"]["source"] = "soda"


def wiggle_ring(c):
    c["q"][16] += 0.05


def more_friction(c):
    c["thresholds"]["friction"] = c["certificate"]["friction"] = 0.7


def same_words(key, value):
    return lambda c: c.__setitem__(key, value)


def claims(key, value):
    return lambda c: c["certificate"].__setitem__(key, value)


@pytest.mark.parametrize(
    ("tamper", "expected"),
    [
        (no_press, {"squeeze = grasp + J^T f / kp as stated"}),
        (hand_alike, {"grasp: tips from the surface"}),
        (never_opens, {"grasp: tips from the surface"}),
        (stays_home, {"pregrasp: tips from their contacts"}),
        (strays, {"lift: stray"}),
        (twitches, {"approach: bend"}),
        (through_the_object, {"approach: collision", "approach ends at the pregrasp as stated"}),
        (hurries, {"approach: times as stated", "approach: velocity over its limit"}),
        (lighter, {"mass as stated"}),
        (elsewhere, {"hull outside the object's", "hull_offset as stated"}),
        (other_object, {"object content_hash"}),
        (wiggle_ring, {"ring still as stated"}),
        (more_friction, {"thresholds looser than ours"}),
        (same_words("frame", "world"), {"frame"}),
        (same_words("finger_order", ["index", "thumb", "middle"]), {"finger_order"}),
        (same_words("units", {"length": "mm"}), {"units"}),
        (same_words("agent", "nobody"), {"agent"}),
        (claims("load", 2.6), {"load as claimed"}),
        (claims("capacity", 9.0), {"capacity as claimed"}),
        (claims("friction", 0.51), {"friction as claimed"}),
        (claims("holds", False), {"holds as claimed"}),
        (claims("hold_residual", 0.01), {"hold_residual as claimed"}),
        (claims("force_ratio_percent", 0.1), {"force_ratio_percent as claimed"}),
        (claims("torque_ratio_percent", 0.1), {"torque_ratio_percent as claimed"}),
        (claims("closure_residual", 0.1), {"closure_residual as claimed"}),
        (shift_joints, {"contacts as claimed", "distances_cm as claimed"}),
        (shift_arm, {"contacts as claimed"}),
        (double_forces, {"forces leave of gravity"}),
        (weaken_forces, {"forces leave of gravity"}),
        (slide_forces, {"share of friction used"}),
        (pull, {"least pressing force", "forces leave of gravity"}),
        (crush, {"joint torque over limit"}),
        (move_contacts, {"contacts as claimed"}),
        (turn_normals, {"normals as claimed"}),
        (raise_margin, {"closure_margin as claimed"}),
        (claim_distances, {"distances_cm as claimed"}),
        (shift_hull, {"contacts as claimed"}),
        (grow_hull, {"distance:thumb", "distance:index", "distance:middle"}),
        (sink, {"clearance hand_table"}),
        (open_wide, {"pregrasp clearance hand_object"}),
        (break_limit, {"joint limits:squeeze"}),
        (heavier, {"forces leave of gravity"}),
        (off_centre, {"torques leave of gravity"}),
        (slippery, {"closure_margin as claimed"}),
        (claim_room, {"min_clearance_m over the true one"}),
        (claim_strength, {"max_joint_torque_fraction as claimed"}),
        (claim_range, {"joint_limit_margin_rad as claimed"}),
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
        (raise_margin, {"closure_margin as claimed"}),
        (claim_distances, {"distances_cm as claimed"}),
        (claim_room, {"min_clearance_m over the true one", "min_clearance_m as claimed"}),
        (claim_strength, {"max_joint_torque_fraction as claimed"}),
        (claim_range, {"joint_limit_margin_rad as claimed"}),
    ):
        content = copy.deepcopy(contents["sugar_box"])
        tamper(content)
        assert failing(check(content)) == expected


def test_small_shifts_of_every_joint_that_bears_a_grasping_tip_are_seen(contents):
    for joint in (*range(7), *range(7, 15), *range(19, 23)):
        content = copy.deepcopy(contents["pear"])
        content["q"][joint] += 0.01
        failed = {c.name for c in verify(record_of(content), ["contacts"]) if not c.holds}
        assert "contacts as claimed" in failed, joint


# Grasp files


def test_round_trip(contents, tmp_path):
    content = contents["pear"]
    write_grasp(tmp_path / "g.json", content)
    record = read_grasp(tmp_path / "g.json")
    for name in ("q", "pregrasp", "grasp", "squeeze", "contacts", "normals", "forces", "centre"):
        np.testing.assert_array_equal(record.arrays[name], content[name])
    np.testing.assert_array_equal(record.hull, content["hull_vertices"])
    assert record.object.name == record.object.source == "pear"
    assert record.mount == "palm_normal"
    assert record.mass == content["certificate"]["mass"] == content["object"]["known_mass"]
    assert record.thresholds == FROZEN
    np.testing.assert_array_equal(record.approach.setpoints[0], HOME)
    np.testing.assert_array_equal(record.lift.setpoints[0], content["squeeze"])
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
        (put("schema", 3), "schema 2"),
        (drop("schema"), "schema 2"),
        (drop("q"), "q"),
        (drop("thresholds"), "thresholds"),
        (drop("hull_vertices"), "hull_vertices"),
        (put("q", [0.0] * 22), r"q must be .*\(23,\)"),
        (put("q", ["a"] * 23), "q must be"),
        (put("q", None), "q must be"),
        (put("forces", [[0.0, 0.0, 1.0]] * 2), r"forces must be .*\(3, 3\)"),
        (put("forces", [[0, 0, float("nan")]] * 3), "forces must be finite"),
        (put("squeeze", [float("inf")] * 23), "squeeze must be finite"),
        (put("hull_vertices", [[0, 0, 0]] * 3), "V >= 4"),
        (put("hull_vertices", [[0.0, 0.0, float("nan")]] * 8), "hull_vertices"),
        (put("hull_vertices", [[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0], [0.1, 0.1, 0]]), "hull"),
        (put("mount", "sideways"), "palm_normal"),
        (put("mass", "heavy", "certificate"), "mass"),
        (put("mass", float("nan"), "certificate"), "mass"),
        (put("mass", -1.0, "certificate"), "mass"),
        (put("known_mass", 10**400, "object"), "known_mass"),
        (put("scale", True, "object"), "scale"),
        (put("object", "pear"), "grasp"),
        (put("setpoints", [[0.0] * 23], "approach"), "setpoints"),
        (put("setpoints", [[0.0] * 22] * 3, "lift"), "lift"),
        (put("times", "now", "lift"), "times"),
        (put("holds", 1, "certificate"), "holds"),
        (put("hull_offset", None), "go together"),
        (drop("lift"), "lift"),
        (drop("units"), "units"),
        (put("agent", 3), "agent"),
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
    "text",
    [
        "",
        "{",
        "[]",
        "3",
        "null",
        '{"schema": 1}',
        '{"schema": 2, "grasp": null}',
        "\udcff",
        "[" * 100000,
        "1" * 5000,
        '{"schema": true}',
        '{"schema": 1e999}',
    ],
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


# Files of 0.1.0, planned friction


def as_schema_1(content):
    """The file that 0.1.0 would have written."""
    certificate = content["certificate"]
    limits = ("friction", "friction_hold", "distance", "tip_radius", "closure_margin", "clearance")
    kept = (
        "mount",
        "q",
        "pregrasp",
        "grasp",
        "squeeze",
        "contacts",
        "normals",
        "forces",
        "centre",
        "hull_vertices",
    )
    return copy.deepcopy({name: content[name] for name in (*kept, "certificate")}) | {
        "schema": 1, "frame": "robot_base", "object": "pear", "mass": certificate["mass"], "T_world_object": None,
        "thresholds": {name: content["thresholds"][name] for name in limits},
    }  # fmt: skip


def test_older_files_are_checked_as_far_as_they_go(contents):
    old = as_schema_1(contents["pear"])
    record = record_of(old)
    assert all(check.holds for check in verify(record))
    assert {"approach", "lift", "object", "strength"} <= set(unchecked(record))
    assert unchecked(record_of(contents["pear"])) == []
    old["squeeze"][8] = UPPER[8] + 0.01
    assert "joint limits:squeeze" in {c.name for c in verify(record_of(old)) if not c.holds}


def test_a_grasp_without_a_way_to_it_is_not_verified(contents, check):
    content = contents["pear"] | {"approach": None, "lift": None}
    assert failing(check(content)) == {"approach given", "lift given"}


def test_planned_friction_is_a_share_of_the_true_one_and_never_more_than_frozen():
    assert planned_friction(0.7) == pytest.approx((0.5, 0.6))
    assert planned_friction(2.0) == (0.5, 0.6)
    assert planned_friction(0.35) == pytest.approx((0.25, 0.3))
    settings = PlannerSettings.for_friction(0.35)
    assert (settings.friction, settings.friction_hold) == pytest.approx((0.25, 0.3))


def test_thresholds_do_not_move_with_the_planners_defaults(contents, check):
    content = copy.deepcopy(contents["pear"])
    content["thresholds"]["clearance"] = 0.002
    assert "thresholds as frozen" in failing(check(content))
    content["thresholds"]["clearance"] = 0.0005
    assert "thresholds looser than ours" in failing(check(content))
