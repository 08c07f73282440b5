"""Grasp files: read as they were written, and refused in one line."""

import copy
import json
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from refusals import refused
from robots import HOME

from dexgrasp.grasp.file import read_grasp, record_of, write_grasp
from dexgrasp.grasp.identity import surface_hash
from dexgrasp.grasp.record import as_json
from dexgrasp.grasp.thresholds import FROZEN
from dexgrasp.grasp.verify.verify import verify
from dexgrasp.planning.scene_setup import subject_of


def test_round_trip(contents, tmp_path):
    content = contents["pear"]
    write_grasp(tmp_path / "g.json", content)
    record = read_grasp(tmp_path / "g.json")
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
    failed = {check.name for check in verify(record, ["conventions"]) if not check.holds}
    assert "holds_probability as the model says" not in failed


@pytest.mark.parametrize(("schema", "words"), [
    (2, "schema 2 is read by dexgrasp 0.3.0"), (1, "not a grasp of schema 3"), (3.0, "not a grasp of schema 3"),
])  # fmt: skip
def test_files_of_other_schemas_are_refused_in_a_line(schema, words, contents):
    with refused(words):
        record_of(contents["pear"] | {"schema": schema})


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
        (drop("q"), "q"),
        (put("q", [0.0] * 22), "q, pregrasp, grasp and squeeze have 23"),
        (put("q", None), "q is None: valid is finite numbers"),
        (put("contacts", []), "contacts is .*: valid is a list of 2"),
        (put("force", [0.0, 1.0], "contacts", 1), r"contact 1 force is .* \(3\)"),
        (put("finger", "index", "contacts", 0), "different fingers"),
        (put("finger", "toe", "contacts", 0), "fingers of index, middle, ring, thumb"),
        (put("parts", []), "parts is .*: valid is 1 to 64"),
        (put("parts", [[[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0], [0.1, 0.1, 0]]]), "parts is .* around a volume"),
        (put("neighbours", [3]), "neighbour 0 is no mapping"),
        (put("robot", "simulated"), "grasp"),
        (put("table_height", "low"), "table_height"),
        (put("mount", "sideways"), "palm_normal"),
        (put("known_mass", 10**400, "object"), "cut off"),
        (put("setpoints", [[0.0] * 22] * 3, "script", "phases", 1), "setpoints of 23 numbers"),
        (put("name", "approach", "script", "phases", 1), "phases are approach and lift"),
        (put("lift_height", 3.0, "script"), "lift_height"),
        (put("holds", 1, "certificate"), "holds"),
        (put("hull_offset", None), "go together"),
        (put("friction", -0.5, "thresholds"), "friction"),
        (put("certificate", {}), "distances_cm is missing"),
        (put("distances_cm", [0.1, 0.2], "certificate"), "distances_cm"),
        (put("T_world_object", [[1.0]]), "T_world_object"),
    ],
)
def test_malformed_files_are_one_line(change, words, contents, tmp_path):
    content = copy.deepcopy(contents["pear"])
    change(content)
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(content))
    with refused(words) as caught:
        verify(read_grasp(path))
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
