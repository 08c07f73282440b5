"""Readers of grasp files: layouts, frames, orders, and what must never be executed."""

import json
import os
import pickle

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from processes import typed
from refusals import refused
from robots import HAND_JOINTS
from tables import table

from dexgrasp.evaluation.scoring.readers import ReadOptions, read_candidates
from dexgrasp.evaluation.scoring.readers.dexgraspbench import read_dictionary
from dexgrasp.evaluation.scoring.readers.json_files import FORMAT
from dexgrasp_env.poses import pose_matrix

OFFSET = np.array([0.02, -0.01, 0.05])  # of the box's centre in the mesh file, m
SIDES = (0.05, 0.06, 0.10)


@pytest.fixture
def folder(tmp_path):
    box = trimesh.creation.box(SIDES)
    box.apply_translation(OFFSET)
    (tmp_path / "meshes").mkdir()
    box.export(tmp_path / "meshes" / "crate.obj")
    return tmp_path


def options(folder, **more):
    return ReadOptions(meshes=(folder / "meshes",), **more)


def dictionary(**more):
    row = np.concatenate([[0.4, 0.1, 0.2, 1, 0, 0, 0], np.linspace(0.1, 0.4, 16)])
    return {
        "pregrasp_qpos": row, "grasp_qpos": row + np.r_[np.zeros(7), np.full(16, 0.1)], "squeeze_qpos": row,
        "obj_pose": np.array([0.3, 0.0, 0.0, 1, 0, 0, 0]), "obj_scale": 1.0, "obj_path": "assets/x/crate", **more,
    }  # fmt: skip


def saved(path, content):
    np.save(path, content, allow_pickle=True)
    return path


# -- what must not run ------------------------------------------------------------------------------------------


class Evil:
    def __reduce__(self):
        return os.mkdir, ("executed",)


class EvilCalls:
    """Reaches for a function through a module that is on the list."""

    def __reduce__(self):
        return np.fromfile, ("/etc/hostname",)


@pytest.mark.parametrize("content", [{"grasp_qpos": Evil()}, {"grasp_qpos": EvilCalls()}])
@pytest.mark.parametrize("suffix", [".npy", ".pkl"])
def test_nothing_pickled_is_executed(tmp_path, monkeypatch, content, suffix):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / f"evil{suffix}"
    if suffix == ".npy":
        saved(path, content)
    else:
        path.write_bytes(pickle.dumps(content))
    with refused("is not read \\(it asks for"):
        read_dictionary(path)
    assert not (tmp_path / "executed").exists()


def test_a_name_with_dots_does_not_reach_past_the_list(tmp_path):
    """Protocol 4 looks names up by attribute paths: numpy's dtype would lead to other modules."""
    code = b"\x80\x04\x8c\x05numpy\x8c\x10ndarray.__init__\x93."
    (tmp_path / "dots.pkl").write_bytes(code)
    with refused("asks for"):
        read_dictionary(tmp_path / "dots.pkl")


# -- layouts ----------------------------------------------------------------------------------------------------


def test_dexgraspbench_layout_frames_and_order(folder):
    (found,) = read_candidates(saved(folder / "g.npy", dictionary()), options(folder))
    # The object's frame goes from the mesh file's origin to the centre of mass.
    assert_allclose(found.T_world_object[:3, 3], OFFSET + np.array([0.3, 0.0, 0.0]), atol=1e-6)
    # Their root's x axis is our palm's z axis: quaternion (0, 1, 0, 1).
    assert_allclose(found.grasp.T_world_hand[:3, 2], [1, 0, 0], atol=1e-12)
    assert_allclose(found.grasp.T_world_hand[:3, 0], [0, 0, 1], atol=1e-12)
    assert_allclose(found.grasp.joints, np.linspace(0.2, 0.5, 16))
    assert found.hand.joint_names == HAND_JOINTS
    assert found.squeeze_for(5.0) is found.squeeze


def test_dexgraspbench_many_grasps_and_apart_poses(folder):
    row = dictionary()["grasp_qpos"]
    many = {f"{s}_qpos": np.stack([row, row + 0.01])[:, 7:] for s in ("pregrasp", "grasp", "squeeze")}
    many |= {f"{s}_pose": np.stack([row, row])[:, :7] for s in ("pregrasp", "grasp", "squeeze")}
    found = read_candidates(saved(folder / "m.npy", dictionary(**many)), options(folder))
    assert [c.source[-3:] for c in found] == ["[0]", "[1]"]
    assert found[1].grasp.joints[0] == pytest.approx(found[0].grasp.joints[0] + 0.01)


def test_bodex_layout_gives_the_palm_itself(folder):
    rows = np.stack([np.stack([dictionary()["grasp_qpos"]] * 3)] * 4)[None]
    content = {"robot_pose": rows, "obj_pose": dictionary()["obj_pose"][None], "obj_scale": np.array([1.0])}
    (folder / "crate").mkdir()
    found = read_candidates(saved(folder / "crate" / "b_grasp.npy", content), options(folder))
    assert len(found) == 4
    assert_allclose(found[0].grasp.T_world_hand[:3, :3], np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"obj_path": "nowhere"}, "mesh of object 'nowhere' not found"),
        ({"squeeze_qpos": np.zeros(5)}, "valid is \\(23,\\)"),
        ({"grasp_qpos": np.full(23, np.nan)}, "finite"),
        ({"obj_scale": -1.0}, "not a positive number"),
        ({"grasp_qpos": np.zeros(23)}, "quaternion"),
        ({"obj_pose": "here"}, "obj_pose must be finite numbers"),
    ],
)
def test_dexgraspbench_mistakes(folder, change, words):
    with refused(words):
        read_candidates(saved(folder / "g.npy", dictionary(**change)), options(folder))


def frogger(folder, **more):
    from dexgrasp.evaluation.scoring.readers.frogger import JOINTS, PALM

    names = [*JOINTS][::-1]
    values = {ours: 0.1 + 0.01 * i for i, ours in enumerate(HAND_JOINTS)}
    palm = pose_matrix(np.array([0.5, 0.0, 0.3]), np.array([0.0, 1.0, 0.0, 0.0]))
    content = {
        "q": np.array([values[JOINTS[n]] for n in names]), "joint_names": np.array(names), "X_WO": np.eye(4),
        "body_names": np.array(["arm", PALM]), "body_poses_W": np.stack([np.eye(4), palm]), "object": "crate",
    }  # fmt: skip
    np.savez(folder / "f.npz", **content, **table("frogger"), **more)
    return folder / "f.npz"


def test_frogger_layout_by_names_and_palm(folder):
    (found,) = read_candidates(frogger(folder), options(folder))
    assert_allclose(found.grasp.joints, 0.1 + 0.01 * np.arange(16))
    assert_allclose(found.grasp.T_world_hand[:3, 3], [0.5, 0.0, 0.3 - 0.095], atol=1e-12)
    assert_allclose(found.T_world_object[:3, 3], OFFSET, atol=1e-6)
    press = found.squeeze_for(5.0).joints - found.grasp.joints
    assert_allclose(press, 2.0 * (found.squeeze.joints - found.grasp.joints))


def plain(folder, **more):
    names = list(HAND_JOINTS)[::-1]
    stage = {"T_world_hand": [0.4, 0, 0.2, 0, 1, 0, 0], "joints": list(np.arange(16) / 20)}
    grasp = {
        "object": "crate.obj", "T_world_object": np.eye(4).tolist(), "servo_kp": 4.0, "pregrasp": stage,
        "grasp": stage, "squeeze": stage | {"joints": list(np.arange(16) / 20 + 0.1)}, **more,
    }  # fmt: skip
    path = folder / "plain.json"
    path.write_text(json.dumps({"format": FORMAT, "joint_names": names, "grasps": [grasp]}))
    return path


def test_plain_json(folder):
    (found,) = read_candidates(plain(folder), options(folder))
    assert_allclose(found.grasp.joints, np.arange(16)[::-1] / 20)
    assert_allclose(found.squeeze_for(2.0).joints - found.grasp.joints, np.full(16, 0.2))
    content = json.loads(plain(folder).read_text())
    del content["grasps"][0]["squeeze"]
    (folder / "plain.json").write_text(json.dumps(content))
    with refused("contacts is missing"):
        read_candidates(folder / "plain.json", options(folder))
    content["grasps"][0] |= {"contacts": [[0.5, 0.0, 0.2]] * 3, "normals_in": [[0.0, 0.0, 1.0]] * 2}
    (folder / "plain.json").write_text(json.dumps(content))
    with refused("differ in number"):
        read_candidates(folder / "plain.json", options(folder))


# -- the command ------------------------------------------------------------------------------------------------


def test_score_command(folder, capsys, printed):
    files = [
        str(saved(folder / f"{i}.npy", dictionary(obj_pose=np.r_[0.3 + i, 0, 0, 1, 0, 0, 0]))) for i in (0, 1)
    ]
    code = typed(f"score {' '.join(files)} --mesh {folder / 'meshes'} --protocol dgb_tabletop --json")
    found = printed()
    assert code == 1  # a hand that is not there holds nothing
    assert (found["grasps"], found["protocols"]["dgb_tabletop"]["successes"]) == (2, 0)
    assert {row["reason"] for row in found["rows"]} == {"moved"}
    assert found["protocols"]["dgb_tabletop"]["ci95"][1] < 0.7
    assert typed(f"score {files[0]} --protocol lift") == 2
    assert "valid are dgb_fc" in capsys.readouterr().err
    assert typed(f"score {files[0]}") == 2
    assert "--mesh" in capsys.readouterr().err
