"""`dexgrasp plan`, `verify` and `demo`: exit codes, JSON, files, one-line errors."""

import functools
import json

import numpy as np
import pytest
import trimesh
from processes import typed

from dexgrasp.cli.codes import ANSWER_IS_NO, OK
from dexgrasp.planning import scene_setup as look
from dexgrasp_env.objects.load import load_object
from dexgrasp_env.rendering import rendering_fault

CERTIFICATE = {
    "force_ratio_percent", "torque_ratio_percent", "closure_margin", "min_clearance_m", "joint_limit_margin_rad",
    "max_joint_torque_fraction",
}  # fmt: skip


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """A folder with grasp.json and grasp.png, and the command's exit code."""
    folder = tmp_path_factory.mktemp("grasps") / "pear"
    return folder, typed(f"plan pear --seed 1 --out {folder}")


def test_plan_json_is_what_the_interface_says(printed):
    assert typed("plan pear --seed 1 --json") == OK
    result = printed()
    assert result["schema"] == 1
    assert result["object"] == "pear"
    assert result["success"] is True
    assert result["reason"] is None
    assert 0 < result["planning_seconds"] < 30
    certificate = result["certificate"]
    assert len(certificate["distances_cm"]) == 3
    assert all(-0.68 - 1e-4 <= d <= -0.32 + 1e-4 for d in certificate["distances_cm"])
    assert all(type(certificate[key]) is float for key in CERTIFICATE)
    assert certificate["holds"] is True
    grasp = result["grasp"]
    assert np.shape(grasp["q"]) == (23,)
    assert [contact["finger"] for contact in grasp["contacts"]] == ["thumb", "index", "middle"]
    assert np.shape([contact["force"] for contact in grasp["contacts"]]) == (3, 3)
    assert grasp["certificate"] == certificate


def test_plan_writes_files_that_verify(planned, capsys, tmp_path, printed):
    folder, code = planned
    assert code == OK
    assert (folder / "grasp.png").read_bytes()[:4] == b"\x89PNG"
    capsys.readouterr()
    assert typed(f"verify {folder / 'grasp.json'}") == OK
    out = capsys.readouterr().out
    assert "every constraint holds" in out
    assert "FAIL" not in out
    assert typed(f"verify {folder / 'grasp.json'} --json") == OK
    result = printed()
    assert result["holds"] is True
    assert all(set(check) == {"name", "value", "bound", "holds"} for check in result["checks"])
    assert typed("plan pear --seed 1 --json") == OK
    (tmp_path / "whole.json").write_text(capsys.readouterr().out)
    assert typed(f"verify {tmp_path / 'whole.json'}") == OK


def test_verify_says_no_and_which_check(planned, capsys, tmp_path, printed):
    content = json.loads((planned[0] / "grasp.json").read_text())
    content["contacts"][0]["point"][0] += 0.005
    path = tmp_path / "moved.json"
    path.write_text(json.dumps(content))
    capsys.readouterr()
    assert typed(f"verify {path}") == ANSWER_IS_NO
    out = capsys.readouterr().out
    failed = [line.split("  ")[1] for line in out.splitlines() if line.startswith("FAIL")]
    assert {"contacts as claimed", "squeeze = grasp + J^T f / kp as stated"} <= set(failed)
    assert "NOT verified" in out
    both = f"verify {planned[0] / 'grasp.json'} {path}"
    assert typed(both) == ANSWER_IS_NO
    first, second, last = capsys.readouterr().out.splitlines()
    assert (first[:4], second[:4], last) == ("ok  ", "FAIL", "1 of 2 grasps hold every constraint")
    assert typed(f"{both} --json") == ANSWER_IS_NO
    assert [grasp["holds"] for grasp in printed()["grasps"]] == [True, False]


def mesh_file(folder, mesh, name="part.stl"):
    mesh.export(folder / name)
    return str(folder / name)


def test_what_cannot_be_grasped_is_1_with_a_reason(capsys, tmp_path, printed):
    command = f"plan {mesh_file(tmp_path, trimesh.creation.box((0.25, 0.25, 0.004)))} --mesh-mass 0.3"
    assert typed(f"{command} --json --out {tmp_path / 'out'}") == ANSWER_IS_NO
    result = printed()
    assert (result["success"], result["grasp"], result["certificate"]) == (False, None, None)
    assert not (tmp_path / "out" / "grasp.json").exists()
    assert typed(command) == ANSWER_IS_NO
    assert result["reason"] in capsys.readouterr().out


def test_demo_without_gl_still_grasps(capsys, tmp_path, monkeypatch):
    """The whole job but for the pictures that need GL."""
    monkeypatch.setattr("dexgrasp_env.rendering.rendering_fault", lambda: "no GL here")
    assert typed(f"demo --out {tmp_path} --json") == OK
    captured = capsys.readouterr()
    result = json.loads(captured.out)
    assert result["success"] is True
    assert result["outcome"]["is_success"] is True
    assert result["outcome"]["object_height"] > 0.1
    files = {file.name for file in tmp_path.iterdir()}
    assert files == {"cloud.png", "grasp.json", "grasp.png"}
    assert "no GL" in captured.err
    assert typed(f"verify {tmp_path / 'grasp.json'}") == OK


@pytest.mark.skipif(rendering_fault() is not None, reason="no GL library here")
def test_demo_end_to_end(capsys, tmp_path, monkeypatch):
    import imageio.v3 as imageio

    small = functools.partial(look.look_at, render_size=(96, 128))  # drawing in software is slow
    monkeypatch.setattr(look, "look_at", small)
    assert typed(f"demo --out {tmp_path}") == OK
    out = capsys.readouterr().out
    assert "sugar_box: lifted" in out
    files = {file.name for file in tmp_path.iterdir()}
    assert files == {"cloud.png", "grasp.json", "grasp.png", "demo.mp4", "demo.png"}
    sheet = imageio.imread(tmp_path / "demo.png")
    assert sheet.std() > 10
    first, *_, last = imageio.imiter(tmp_path / "demo.mp4")
    assert np.abs(first.astype(int) - last.astype(int)).mean() > 1


def test_a_floating_grasp_is_of_the_known_shape_and_is_scored(tmp_path, printed):
    assert typed(f"plan sugar_box --floating --seed 5 --friction 0.6 --out {tmp_path} --json") == OK
    grasp = printed()["grasp"]
    T = np.array(grasp["T_world_object"])
    assert T[2, 3] > 0.3
    assert grasp["certificate"]["mass"] == pytest.approx(0.1)
    mesh = load_object("sugar_box").mesh
    local = (np.array([contact["point"] for contact in grasp["contacts"]]) - T[:3, 3]) @ T[:3, :3]
    assert np.abs(trimesh.proximity.signed_distance(mesh, local)).max() < 1e-4
    assert typed(f"score {tmp_path / 'grasp.json'} --protocol dgb_fc --json") == OK
    assert printed()["protocols"]["dgb_fc"]["successes"] == 1
