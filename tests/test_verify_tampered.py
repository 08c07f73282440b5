"""Tampered grasps are caught by the right check, and by no other."""

import copy
from functools import reduce
from operator import getitem

import numpy as np
import pytest
from planned import failing
from refusals import rejected
from robots import HOME, LOWER, UPPER
from tables import table
from tampering import named, standing

from dexgrasp.grasp.file import record_of


def shift_joints(c):
    c["q"] = (np.array(c["q"]) + 0.02 * np.r_[np.zeros(7), np.ones(16)]).tolist()


def of(c, key):
    return np.array([contact[key] for contact in c["contacts"]])


def put(c, key, rows):
    for contact, row in zip(c["contacts"], rows.tolist(), strict=True):
        contact[key] = row


def phase(c, name):
    return next(phase for phase in c["script"]["phases"] if phase["name"] == name)


def slide_forces(c):
    put(c, "force", of(c, "force") + 30 * np.cross(of(c, "normal"), [0.1, 0.2, 0.97]))


def pull(c):
    put(c, "force", -of(c, "force"))


def crush(c):
    """Add a balanced squeeze that no joint can press with."""
    p = of(c, "point")
    inward = p.mean(0) - p
    put(c, "force", of(c, "force") + 3000 * (inward - inward.mean(0)))


def turn_normals(c):
    put(c, "normal", np.roll(of(c, "normal"), 1, axis=0))


def swap_fingers(c):
    c["contacts"][0]["finger"], c["contacts"][1]["finger"] = "index", "thumb"


def drop_contact(c):
    c["contacts"].pop()
    c["certificate"]["distances_cm"].pop()


def shift_hull(c):
    c["parts"] = [(np.array(part) + np.array([0, 0.006, 0])).tolist() for part in c["parts"]]


def grow_hull(c):
    v = np.array(c["parts"][0])
    c["parts"] = [(v.mean(0) + 1.3 * (v - v.mean(0))).tolist()]


def sink(c):
    """Everything 10 cm lower, as a hull that goes through the table: the hand meets the table's other side."""
    c["q"][1] += 0.25


def open_wide(c):
    c["pregrasp"] = list(c["q"])


def cross_fingers(c):
    """Index and middle base turned towards each other: their links overlap."""
    c["q"][7], c["q"][11] = LOWER[7], UPPER[11]


def no_press(c):
    c["squeeze"] = list(c["grasp"])


def never_opens(c):
    c["grasp"] = list(c["pregrasp"])


def stays_home(c):
    c["pregrasp"] = HOME.tolist()
    phase(c, "approach")["setpoints"] = [HOME.tolist() for _ in phase(c, "approach")["times"]]


def strays(c):
    for row in phase(c, "lift")["setpoints"][5:]:
        row[0] += 0.1


def twitches(c):
    phase(c, "approach")["setpoints"][10][3] += 0.01


def through_the_object(c):
    ends = np.array(phase(c, "approach")["setpoints"])
    phase(c, "approach")["setpoints"] = np.linspace(ends[0], c["q"], len(ends)).tolist()


def hurries(c):
    way = phase(c, "approach")
    way["times"], way["setpoints"] = way["times"][::4], way["setpoints"][::4]


def lighter(c):
    c["object"]["known_mass"] = None
    c["certificate"]["mass"] *= 0.001
    put(c, "force", 0.001 * of(c, "force"))


def nowhere(c):
    c["T_world_object"] = c["hull_offset"] = None


def weigh_less(c):
    """As if the object were 20 g: all that follows from the mass follows."""
    share = 0.02 / c["object"]["known_mass"]
    c["object"]["known_mass"] = c["certificate"]["mass"] = 0.02
    put(c, "force", share * of(c, "force"))


def told_wrongly(c):
    c["object"]["known_centre"] = c["centre"] = (np.array(c["centre"]) + 0.03).tolist()


def more_friction(c):
    c["thresholds"]["friction"] = c["certificate"]["friction"] = 0.7


def put_at(c, value, *path):
    """Change what lies at a path of keys and places."""
    reduce(getitem, path[:-1], c)[path[-1]] = value


def plus(c, amount, *path):
    put_at(c, reduce(getitem, path, c) + amount, *path)


def over_the_limit(c):
    put_at(c, UPPER[8] + 0.01, "squeeze", 8)


@pytest.mark.parametrize(("change", "arguments", "expected"), table("tampered"))
def test_tampered_grasps_fail_with_the_right_check(change, arguments, expected, contents, check):
    content = copy.deepcopy(contents["sugar_box"])
    globals()[change](content, *arguments)
    broken = failing(check(content))
    assert broken.issuperset(expected), broken


def test_one_hull_does_not_pass_for_its_parts(contents, check):
    """The hand reaches into the air of the hull: it is clear of the parts alone."""
    content = copy.deepcopy(contents["hammer"])
    content["parts"] = [[corner for part in content["parts"] for corner in part]]
    assert {"contacts as claimed", "centre of mass as stated"} <= failing(check(content))


def test_a_moved_corner_of_any_part_is_seen(contents):
    for part, corners in enumerate(contents["hammer"]["parts"]):
        for corner in range(len(corners)):
            content = copy.deepcopy(contents["hammer"])
            content["parts"][part][corner][0] += 0.001
            failed = set(rejected(record_of(content), ["object"]))
            assert "centre of mass as stated" in failed, (part, corner)


def test_every_claim_is_computed_again_and_nothing_else_then_fails(contents):
    """A change of the mass is of more than a claim: see above."""
    names = {"holds": "holds as claimed", "min_clearance_m": "min_clearance_m over the true one"}
    claims = contents["sugar_box"]["certificate"]
    for key in claims.keys() - {"mass"}:
        content = copy.deepcopy(contents["sugar_box"])
        value = claims[key]
        changed = [x + 0.05 for x in value] if isinstance(value, list) else 1.1 * value + 0.01
        content["certificate"][key] = not value if key == "holds" else changed
        parts = ("contacts", "limits", "clearance", "closure", "forces", "strength")
        failed = set(rejected(record_of(content), parts))
        assert failed == {names.get(key, f"{key} as claimed")}, key


def test_small_shifts_of_every_joint_that_bears_a_grasping_tip_are_seen(contents):
    for joint in (*range(7), *range(7, 15), *range(19, 23)):
        content = copy.deepcopy(contents["pear"])
        content["q"][joint] += 0.01
        failed = set(rejected(record_of(content), ["contacts"]))
        assert "contacts as claimed" in failed, joint


@pytest.mark.parametrize(("true", "other", "expected"), table("taken_for"))
def test_a_grasp_is_not_taken_for_one_of_another_object_in_its_place(true, other, expected, contents):
    renamed = standing(record_of(contents[true]), other)
    broken = set(rejected(renamed, ["object"]))
    assert expected in broken, broken
    assert {"object content_hash", "object name", "hull_offset as stated"} & broken == set()


def test_a_grasp_named_again_as_what_it_is_passes(contents):
    record = record_of(contents["pear"])
    again = named(record, "pear", record.T_world_object)
    assert rejected(again) == []
