"""Set files: members with units, masses, friction and poses of their own; fetching from a publisher."""

import io
import json
import tarfile
from pathlib import Path

import gymnasium as gym
import pytest
import trimesh
from numpy.testing import assert_allclose
from project_scripts import load_script
from refusals import refused
from tables import mistakes, table

from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.protocol import trial_seeds
from dexgrasp.evaluation.settings import object_labels
from dexgrasp_env.objects.load import load_object, object_name, resolve_targets

BRICK = table("brick")
BALL = {"name": "ball", "mesh": "more/ball.ply", "upright": [0.5, 0.5, 0.5, 0.5]}


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("DEXGRASP_CACHE", str(tmp_path / "cache"))
    (tmp_path / "more").mkdir()
    trimesh.creation.box((50, 60, 80)).export(tmp_path / "brick.stl")
    trimesh.creation.box((0.05, 0.06, 0.07)).export(tmp_path / "more" / "ball.ply")
    return tmp_path


def written(folder: Path, *objects: object, **more: object) -> str:
    path = folder / "my.json"
    path.write_text(json.dumps({"schema": 1, "objects": list(objects)} | more))
    return str(path)


def test_members_have_their_own_unit_mass_friction_and_pose(folder):
    path = written(folder, BRICK, BALL)
    targets = resolve_targets([path, "pear"])
    assert targets == [f"{path}#brick", f"{path}#ball", "pear"]
    brick, ball = map(load_object, targets[:2])
    assert_allclose(brick.extents, [0.05, 0.06, 0.08])
    assert (brick.name, brick.mass, brick.friction) == ("brick", 0.2, 0.4)
    assert (ball.name, ball.friction) == ("ball", None)
    assert_allclose(ball.upright, 0.5)


@pytest.mark.parametrize(("objects", "message"), mistakes("sets"))
def test_a_set_is_checked_as_a_whole(folder, objects, message):
    path = written(folder, *objects)
    with refused() as caught:
        resolve_targets([path])
    assert message in str(caught.value)


def test_a_member_is_named_in_results_and_seeds_by_its_name(folder):
    path = written(folder, BRICK, BALL)
    other = folder / "other.json"
    other.write_text(Path(path).read_text())
    targets = resolve_targets([path, str(other)])
    assert object_name(targets[0]) == "brick"
    labels = object_labels(targets)
    assert len(set(labels.values())) == 4
    assert labels[targets[0]] == "brick"
    assert trial_seeds(0, targets[0], 2) == trial_seeds(0, targets[2], 2) == trial_seeds(0, "brick", 2)
    with refused(r"no object 'x': valid are brick, ball"):
        resolve_targets([f"{path}#x"])


def test_environments_take_the_friction_of_the_member_unless_they_name_one(folder):
    path = written(folder, BRICK)
    for given, expected in ((None, 0.4), (0.9, 0.9)):
        env = gym.make("DexGrasp/Lift-v2", objects=path, friction=given)
        env.reset(seed=0)
        model = env.unwrapped.model
        assert set(model.pair_friction[:, 0]) == {expected}
        assert model.body("object").mass == pytest.approx(0.2)
        env.close()


def archive(content: bytes, name: str = "004_sugar_box") -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:gz") as tar:
        entry = tarfile.TarInfo(f"{name}/google_16k/nontextured.ply")
        entry.size = len(content)
        tar.addfile(entry, io.BytesIO(content))
    return buffer.getvalue()


def test_ycb_meshes_are_fetched_on_the_users_word_and_once(folder, capsys):
    mesh = trimesh.creation.box((0.04, 0.09, 0.17)).export(file_type="ply")
    (folder / "004_sugar_box_google_16k.tgz").write_bytes(archive(mesh))
    fetch, path = load_script("object_sets").Ycb, folder / "sets" / "ycb.json"
    arguments = [str(path), "--objects", "004_sugar_box", "--publisher"]
    assert run_script(fetch, [*arguments, folder.as_uri()]) == 0
    assert not path.exists()
    assert "--yes" in capsys.readouterr().out
    for publisher in (folder.as_uri(), "file:///nowhere"):  # what is in the cache is not fetched again
        assert run_script(fetch, [*arguments, publisher, "--yes"]) == 0
    (target,) = resolve_targets([str(path)])
    model = load_object(target)
    assert (model.name, model.mass) == ("ycb_004_sugar_box", 0.514)
    assert_allclose(model.extents, [0.04, 0.09, 0.17], atol=1e-6)
