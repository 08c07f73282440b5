"""Tampered grasps are caught by the right check, and by no other."""

import copy

import numpy as np
import pytest
from planned import failing

from dexgrasp.grasp.file import record_of
from dexgrasp.verify.verify import verify
from dexgrasp_env.robot.limits import HOME, LOWER, UPPER


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
        (same_words("table_height", 0.01), {"table_height", "contacts as claimed"}),
        (same_words("units", {"length": "mm"}), {"units"}),
        (same_words("agent", "no body"), {"agent"}),
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


def test_one_hull_does_not_pass_for_its_parts(contents, check):
    """The hand reaches into the air of the hull: it is clear of the parts alone."""
    content = copy.deepcopy(contents["hammer"])
    del content["part_sizes"]
    assert {"contacts as claimed", "centre of mass as stated"} <= failing(check(content))


def test_a_moved_corner_of_any_part_is_seen(contents):
    for corner in range(len(contents["hammer"]["hull_vertices"])):
        content = copy.deepcopy(contents["hammer"])
        content["hull_vertices"][corner][0] += 0.001
        failed = {c.name for c in verify(record_of(content), ["object"]) if not c.holds}
        assert "centre of mass as stated" in failed, corner


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
