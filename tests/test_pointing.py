"""Which object of a scene is meant: `dexgrasp plan --cloud` with masks, boxes, pixels and points."""

import json

import numpy as np
import pytest
from processes import typed
from refusals import refused
from tables import mistakes, table
from test_scene_cloud import scene_points

from dexgrasp.cli.codes import ANSWER_IS_NO, BAD_INPUT, OK
from dexgrasp.cli.main import main
from dexgrasp_env.perception.selection import point_of_pixel

PLACES = ((0.5, 0.12), (0.5, -0.02), (0.5, -0.2))


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    """Folder with a cloud of three boxes, the second 6 cm from the first, and a mask with a label for each."""
    folder = tmp_path_factory.mktemp("scan")
    points = scene_points(np.random.default_rng(3), *PLACES)
    np.save(folder / "scene.npy", points)
    np.save(folder / "mask.npy", np.repeat([0, 0, 1, 2, 3], 3000))
    return folder


def plan(scan, *options):
    return main(["plan", "--cloud", str(scan / "scene.npy"), *map(str, options)])


def test_several_objects_are_listed_and_none_is_chosen_in_silence(scan, capsys):
    assert plan(scan) == BAD_INPUT
    said = capsys.readouterr().err
    assert len(said.strip().splitlines()) == 1
    assert "3:" in said
    assert "--object-near" in said
    assert plan(scan, "--objects", "--json", "--out", scan / "list") == OK
    listed = json.loads(capsys.readouterr().out)["objects"]
    assert [one["number"] for one in listed] == [1, 2, 3]
    assert sorted(round(one["next"], 2) for one in listed) == [0.06, 0.06, 0.1]
    assert (scan / "list" / "objects.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize("options", table("pointing_words"))
def test_what_is_pointed_at_is_planned_and_what_stands_beside_is_said(scan, capsys, options):
    options = [scan / value if value == "mask.npy" else value for value in options]
    assert plan(scan, *options, "--json", "--out", scan / "grasp") == OK
    out = capsys.readouterr()
    assert np.allclose(json.loads(out.out)["seen"][0]["place"][:2], PLACES[0], atol=0.01)
    assert "object: 6 x 8 x" in out.err
    assert "cm away" in out.err
    assert len(json.loads((scan / "grasp" / "grasp.json").read_text())["neighbours"]) == 2
    assert typed(f"verify {scan / 'grasp' / 'grasp.json'}") == OK


def test_what_verify_rejects_is_neither_exported_nor_passed(scan, capsys):
    folder = scan / "trajectory"
    assert plan(scan, "--object-near", *PLACES[0], 0.03, "--out", scan) == OK
    assert typed(f"export {scan / 'grasp.json'} --out {folder}") == OK
    assert typed(f"check {folder}") == OK
    assert "robot to what stands around" in capsys.readouterr().out
    content = json.loads((scan / "grasp.json").read_text())
    for one in content["neighbours"]:  # they stand where the object does, and higher
        middle = np.mean(one["parts"][0], axis=0)
        one["pose"][0][3], one["pose"][1][3], one["pose"][2][3] = *(PLACES[0] - middle[:2]), 0.06
    (scan / "moved.json").write_text(json.dumps(content))
    assert typed(f"verify {scan / 'moved.json'}") == ANSWER_IS_NO
    assert typed(f"export {scan / 'moved.json'} --out {scan / 'refused'}") == ANSWER_IS_NO
    assert not (scan / "refused" / "arm.csv").exists()
    assert "--force" in capsys.readouterr().out
    assert typed(f"export {scan / 'moved.json'} --out {folder} --force") == OK
    assert json.loads((folder / "segments.json").read_text())["rejected"]
    assert typed(f"check {folder}") == ANSWER_IS_NO
    said = capsys.readouterr().out
    assert "grasp.json: " in said
    assert "NOT fit to run" in said


@pytest.mark.parametrize(("options", "words"), mistakes("pointing"))
def test_pointing_at_nothing_is_one_line(scan, capsys, options, words):
    np.save(scan / "short.npy", np.ones(5, bool))
    np.save(scan / "empty.npy", np.zeros(15000, bool))
    np.save(scan / "floats.npy", np.zeros(15000))
    options = [scan / value if str(value).endswith(("npy", "ply")) else value for value in options]
    assert plan(scan, *options) == BAD_INPUT
    said = capsys.readouterr().err
    assert words in said
    assert len(said.strip().splitlines()) == 1


def test_a_pixel_is_the_point_behind_it(tmp_path):
    depth = np.full((8, 10), 0.5, np.float32)
    depth[0, 0] = np.nan
    np.save(tmp_path / "d.npy", depth)
    camera = table("front_camera")
    content = {"cameras": [camera | {"T_base_camera": np.eye(4).tolist()}]}
    (tmp_path / "cameras.yaml").write_text(json.dumps(content))
    np.testing.assert_allclose(point_of_pixel(tmp_path, "front", 4, 3), [0.15, 0.15, 0.5])
    for wrong in mistakes("pixels"):
        with refused():
            point_of_pixel(tmp_path, *wrong)
