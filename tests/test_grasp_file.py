"""Grasp files: read as they were written, and refused in one line."""

import copy
import json
from dataclasses import replace
from functools import reduce
from operator import getitem

import gymnasium as gym
import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from refusals import refused, rejected
from robots import HOME
from tables import mistakes

from dexgrasp.grasp.file import read_grasp, record_of, write_grasp
from dexgrasp.grasp.identity import surface_hash
from dexgrasp.grasp.record import as_json
from dexgrasp.grasp.thresholds import FROZEN
from dexgrasp.grasp.verify.verify import verify
from dexgrasp.planning.scene_setup import subject_of


def test_round_trip(contents, tmp_path):
    content = contents["pear"]
    write_grasp(tmp_path / "g.json", content)
    record = read_grasp(f"{tmp_path}/g.json")
    for name in ("q", "pregrasp", "grasp", "squeeze"):
        assert_array_equal(getattr(record, name), content[name])
    for name, rows in (("point", record.points), ("normal", record.normals), ("force", record.forces)):
        assert_array_equal(rows, [contact[name] for contact in content["contacts"]])
    assert_array_equal(record.parts[0], content["parts"][0])
    assert record.fingers == ("thumb", "index", "middle")
    assert record.object.name == record.object.source == "pear"
    assert record.mount == "palm_normal"
    assert record.certificate.mass == content["certificate"]["mass"] == content["object"]["known_mass"]
    assert record.thresholds == FROZEN
    approach, lift = record.script.phases
    assert_array_equal(approach.setpoints[0], HOME)
    assert_array_equal(lift.setpoints[0], content["squeeze"])
    assert json.loads((tmp_path / "g.json").read_text()) == content
    assert as_json(record) == {name: content[name] for name in content if name not in ("version", "created")}
    write_grasp(tmp_path / "whole.json", {"schema": 1, "grasp": content})  # the output of `plan --json`
    assert_array_equal(read_grasp(tmp_path / "whole.json").q, record.q)


def test_neighbours_and_any_number_of_contacts_are_read_as_they_were_written(contents):
    """Frames move with the table's height."""
    content = copy.deepcopy(contents["hammer"])
    pose = np.eye(4)
    pose[:3, 3] = 0.6, 0.1, 0.0
    some = {"pose": pose.tolist(), "parts": content["parts"]}
    content["neighbours"] = [{"name": None} | some, {"name": "mug"} | some]
    content["contacts"].append(content["contacts"][0] | {"finger": "ring"})
    content["certificate"]["distances_cm"].append(-0.5)
    content["holds_probability"] = None
    content["table_height"] = -0.25
    record = record_of(content)
    assert [n.name for n in record.neighbours] == [None, "mug"]
    assert_allclose(record.neighbours[0].pose[:3, 3], [0.6, 0.1, 0.25])
    assert_array_equal(record.neighbours[1].parts[1], content["parts"][1])
    assert record.fingers == ("thumb", "index", "middle", "ring")
    assert record.points.shape == record.forces.shape == (4, 3)
    again = record_of(as_json(record))
    for one, other in (
        (record.centre, again.centre),
        (record.points, again.points),
        (np.concatenate(record.parts), np.concatenate(again.parts)),
    ):
        assert_allclose(one, other, atol=1e-12)
    assert "holds_probability as the model says" not in set(rejected(record, ["conventions"]))


@pytest.mark.parametrize(("path", "value", "words"), mistakes("grasp_files"))
def test_malformed_files_are_one_line(path, value, words, contents, tmp_path):
    content = copy.deepcopy(contents["pear"])
    *outer, key = path
    reduce(getitem, outer, content)[key] = value
    if value == "left out":
        del content[key]
    file = tmp_path / "bad.json"
    file.write_text(json.dumps(content))
    with refused(words) as caught:
        verify(read_grasp(file))
    assert "bad.json" in str(caught.value)


def test_what_has_a_size_of_its_own_has_scale_1(tmp_path):
    """`mesh_scale` is for bare mesh files: members of sets, like the catalogue, do not heed it."""
    trimesh.creation.box((0.06, 0.06, 0.1)).export(tmp_path / "box.stl")
    member = {"name": "box", "mesh": "box.stl", "mass": 0.2}
    (tmp_path / "set.json").write_text(json.dumps({"schema": 1, "name": "one", "objects": [member]}))
    targets = {f"{tmp_path}/set.json#box": False, "varied-3": False, f"{tmp_path}/box.stl": True}
    for target, heeds in targets.items():
        env = gym.make("DexGrasp/Lift-v2", objects=[target, f"{tmp_path}/box.stl"], mesh_scale=0.9)
        env.reset(seed=0, options={"object": target})
        identity = subject_of(env).identity
        env.close()
        assert identity.scale == (0.9 if heeds else 1.0)
        assert surface_hash(identity.load()) == identity.content_hash
        if not heeds:
            with refused("a size of its own"):
                replace(identity, scale=1.01).load()
