"""The cell as data: the default is the model's own numbers, mistakes take a line, another one is used throughout."""

import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import tables
import yaml
from processes import typed
from refusals import refused
from test_scene_cloud import box, table

from dexgrasp.data.dataset.generate import _identity
from dexgrasp.data.dataset.settings import DatasetSettings
from dexgrasp.data.demonstrations.settings import DemoSettings
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp_env.robot.cell import read_cell

LAB = tables.table("lab")
TABLE = LAB["table_height"]


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    path = tmp_path_factory.mktemp("cell") / "lab.yaml"
    path.write_text(yaml.safe_dump(LAB))
    return path


@pytest.mark.parametrize(("change", "words"), tables.mistakes("cells"))
def test_a_mistake_is_said_in_one_line(change, words, tmp_path):
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump({"schema": 1, "name": "mine"} | change))
    with refused(words) as error:
        read_cell(path)
    assert str(path) in str(error.value)


def test_the_environment_is_of_the_cell(lab):
    modes = {"obs_mode": "pointcloud", "control_mode": "joint_delta"}
    env = gym.make("DexGrasp/Lift-v2", objects="pear", robot=str(lab), **modes)
    observation, _ = env.reset(seed=0)
    before = observation["joint_targets"]
    after = env.step(np.r_[1.0, np.zeros(22)].astype(np.float32))[0]["joint_targets"]
    model, data = env.unwrapped.model, env.unwrapped.data
    assert after[0] - before[0] == pytest.approx(
        1.0 * 0.05, rel=1e-5
    )  # its velocity limit times the control period
    assert model.body("palm").pos.tolist() == [0.0475, 0.0, 0.162]
    assert [model.camera(k).name for k in range(model.ncam)] == ["left", "right"]
    seen = observation["cloud"][observation["cloud_mask"] == 1]
    assert len(seen) > 300
    assert data.body("panda_link0").xpos[2] == -TABLE  # in the world the table's top is z = 0
    assert model.camera("left").pos[2] == 0.5 - TABLE
    assert 0.0 < seen[:, 2].min() < 0.01
    assert abs(observation["table_plane"][3]) < 0.005
    assert (model.actuator("thumb_0").gainprm[0], model.actuator("thumb_0").forcerange[1]) == (8.0, 0.5)
    here = {"robot": str(lab)}
    cells = {
        EvaluationSettings.of(["random"], ["pear"], **here).identity()["cell"],
        _identity(DatasetSettings.of(["pear"], **here))["cell"],
        DemoSettings.of(["pear"], **here).as_json()["cell"],
    }
    assert cells == {read_cell(lab).version}


def test_a_grasp_is_planned_verified_and_exported_in_its_cell_alone(lab, tmp_path, capsys):
    folder, scene = tmp_path, tmp_path / "scene.npy"
    rng = np.random.default_rng(0)
    points = np.concatenate([table(rng), box(rng, (0.52, 0.05), np.array([0.06, 0.08, 0.12]))])
    np.save(scene, points + np.array([0.0, 0.0, TABLE]))
    for command, code in {
        f"plan pear --out {folder}": 0,
        f"verify {folder}/grasp.json": 0,
        f"export {folder}/grasp.json --out {folder}/robot": 0,
        f"check {folder}/robot": 0,
        f"plan --cloud {scene} --object-near 0.52 0.05 {TABLE + 0.06} --out {folder}/seen": 0,
        f"verify {folder}/seen/grasp.json": 0,
        f"replay {folder}/none --agent=rl --object=pear --trial=0 --camera=left": 2,
    }.items():
        assert typed(f"{command} --robot {lab}") == code, command
    capsys.readouterr()
    grasp, robot, seen = tmp_path / "grasp.json", tmp_path / "robot", tmp_path / "seen" / "grasp.json"
    for content in (json.loads(path.read_text()) for path in (grasp, seen)):
        assert content["cell"] == "our lab"
        assert content["table_height"] == TABLE
        assert min(c["point"][2] for c in content["contacts"]) > TABLE + 0.015
        assert abs(min(corner[2] for corner in content["parts"][0]) - TABLE) < 0.004
    exported = np.array(json.loads((robot / "segments.json").read_text())["contacts"]["points"])
    assert np.abs(exported - [c["point"] for c in json.loads(grasp.read_text())["contacts"]]).max() < 1e-12
    assert typed(f"verify {grasp}") == 1
    assert "FAIL  cell" in capsys.readouterr().out
    assert typed(f"export {grasp} --out {tmp_path / 'other'}") == 1
    assert "NOT exported: verify rejects it (cell" in capsys.readouterr().out
    assert typed(f"view {grasp} --html {tmp_path / 'page.html'}") == 2
    assert typed(f"check {robot}") == 1


def test_the_page_of_the_docs_shows_a_cell_that_can_be_read(tmp_path):
    page = (Path(__file__).parents[1] / "docs" / "cell.md").read_text()
    path = tmp_path / "cell.yaml"
    path.write_text(page.split("```yaml\n")[1].split("```")[0])
    assert read_cell(path).name == "our lab"
