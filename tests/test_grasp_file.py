"""Grasp files: read as they were written, and refused in one line."""

import copy
import json
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
import trimesh

from dexgrasp.grasp.file import read_grasp, write_grasp
from dexgrasp.grasp.identity import surface_hash
from dexgrasp.grasp.thresholds import FROZEN
from dexgrasp.planning.look import subject_of
from dexgrasp.verify.verify import verify
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.limits import HOME


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


def test_parts_are_read_as_they_were_planned_on(contents, tmp_path):
    assert "part_sizes" not in contents["pear"]
    write_grasp(tmp_path / "g.json", contents["hammer"])
    record = read_grasp(tmp_path / "g.json")
    assert [len(part) for part in record.parts] == [8, 8]
    assert np.ptp(record.parts[1], axis=0) == pytest.approx([0.035, 0.11, 0.05])
    np.testing.assert_array_equal(record.hull, contents["hammer"]["hull_vertices"])


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
        (put("part_sizes", [4, 4]), "part_sizes must be"),
        (put("part_sizes", [4.0, 4]), "part_sizes must be"),
        (put("part_sizes", 3), "part_sizes must be"),
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


def test_what_has_a_size_of_its_own_has_scale_1(tmp_path):
    """`--mesh-scale` is for bare mesh files: members of sets, like the catalogue, do not heed it."""
    trimesh.creation.box((0.06, 0.06, 0.1)).export(tmp_path / "box.stl")
    member = {"name": "box", "mesh": "box.stl", "mass": 0.2}
    (tmp_path / "set.json").write_text(json.dumps({"schema": 1, "name": "one", "objects": [member]}))
    targets = {f"{tmp_path}/set.json#box": False, "varied-3": False, f"{tmp_path}/box.stl": True}
    for target, heeds in targets.items():
        env = gym.make("DexGrasp/Lift-v1", objects=[target], mesh_scale=0.9)
        env.reset(seed=0)
        identity = subject_of(env).identity
        env.close()
        assert identity.scale == (0.9 if heeds else 1.0)
        assert surface_hash(identity.load()) == identity.content_hash
        if not heeds:
            with pytest.raises(InputError, match="a size of its own"):
                replace(identity, scale=1.01).load()
