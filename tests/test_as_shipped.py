"""Makers' own files, where they lie beside the project: tips, couplings and drives are as is known of each hand."""

import csv
import json
from pathlib import Path

import pytest

from dexgrasp_env.robot.hand_maker import HandMaker

FOLDER = next(
    (found for folder in Path(__file__).parents if (found := folder / "shared" / "as_shipped").is_dir()),
    Path(),
)
KNOWN = json.loads((FOLDER / "truth.json").read_text()) if FOLDER.name else {}
FILES = {}
if FOLDER.name:
    with open(FOLDER / "models.tsv") as rows:
        FILES = {row["id"]: FOLDER / row["file"] for row in csv.DictReader(rows, delimiter="\t")}
pytestmark = [pytest.mark.slow, pytest.mark.skipif(not KNOWN, reason="no makers' files are here")]


def led(joint, couplings):
    """Return the joint that leads another in the end, and the product of the ratios on the way."""
    ratio = 1.0
    while joint in couplings:
        joint, ratio = couplings[joint][0], ratio * couplings[joint][1]
    return joint, ratio


@pytest.mark.parametrize("name", KNOWN)
def test_a_makers_hand_is_read_as_it_is(name):
    known, entry = KNOWN[name], HandMaker(FILES[name]).entry()
    ends = [finger["bodies"][-1] for finger in entry["fingers"]]
    assert len(ends) == len(known["tips"])
    assert all(any(end in names for end in ends) for names in known["tips"])
    joints = [joint for finger in entry["fingers"] for joint in finger["joints"]]
    assert {*joints, *entry.get("held", ())} >= known["couplings"].keys()
    found = {own["joint"]: (own["follows"], own["ratio"]) for own in entry.get("couplings", ())}
    for joint, (leader, ratio, _) in known["couplings"].items():
        if joint not in entry.get("held", ()) and leader not in entry.get("held", ()):
            (first, one), (second, other) = led(joint, found), led(leader, found)
            assert first == second
            assert one == pytest.approx(ratio * other, rel=0.02)
    torque = dict(zip(joints, entry["torque"], strict=True))
    stated = {joint: most for joint, most in known["torque"].items() if joint in torque}
    assert {joint: torque[joint] for joint in stated} == pytest.approx(stated, rel=0.02)
    if "grasp" in known:
        of = {finger["name"]: finger["bodies"][-1] for finger in entry["fingers"]}
        assert {of[finger] for finger in entry["grasp"]} == {*known["grasp"]}
