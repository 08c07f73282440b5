import hashlib
import json
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest
from numpy.testing import assert_allclose
from processes import typed
from refusals import refused
from robots import CELL

from dexgrasp.data.dataset.dataset import fields_of, read_dataset, read_manifest
from dexgrasp.data.dataset.generate import generate
from dexgrasp.data.dataset.info import check_sample, summary
from dexgrasp.data.dataset.rest_scene import rest_scene
from dexgrasp.data.dataset.sampler import bearable
from dexgrasp.data.dataset.settings import DatasetSettings
from dexgrasp.mechanics.margin import margins
from dexgrasp.planning.placement import assignments, place_on_atlas
from dexgrasp.planning.postures import loads_on
from dexgrasp.planning.proposals import closure_sweep
from dexgrasp.planning.settings import GraspProblem
from dexgrasp.runs.pool import Backend

SETTINGS = DatasetSettings.of(["gelatin_box"], grasps_per_pose=6, chunk=3, seed=5)


def hashes(folder):
    files = sorted(p for p in folder.rglob("*.npz"))
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data") / "set"
    generate(SETTINGS, folder)
    return folder


def test_every_rest_pose_has_its_grasps_and_they_pass_independent_checks(made):
    poses = read_dataset(made)
    assert len(poses) == 6
    assert [len(p) for p in poses] == [6] * 6
    for pose in poses:
        assert {name: a.shape[1:] for name, a in pose.grasps.items()} == {
            name: tuple(words["shape"]) for name, words in fields_of(CELL.robot).items()
        }
        distance = np.linalg.norm(pose.grasps["normals"], axis=-1)
        assert_allclose(distance, 1.0, atol=1e-5)
        assert (pose.grasps["margin"] >= SETTINGS.planner.closure_margin - 1e-5).all()
    checked = check_sample(made, 12)
    assert checked == {"checked": 12, "passed": 12, "failures": {}}


def test_all_triples_are_decided():
    scene = rest_scene("gelatin_box", 0, SETTINGS)
    points = scene.points
    far = np.linalg.norm(points[:, None] - points[None], axis=-1) >= 0.03
    n = len(points)
    assert scene.decided == sum(
        far[i, j] and far[i, k] and far[j, k] for i in range(n) for j in range(i) for k in range(j)
    )
    assert len(scene.triples) == len(closure_sweep(points, scene.normals, 0.4, 0.03))
    assert points[:, 2].min() > 0.015


def test_no_hand_bears_the_object_at_triples_that_are_left_out():
    scene = rest_scene("mustard_bottle", 0, DatasetSettings.of(["mustard_bottle"]))
    triples, planner = scene.triples[:: len(scene.triples) // 300], SETTINGS.planner
    kept = {tuple(t) for t in bearable(scene, triples, SETTINGS)}
    problem = GraspProblem(scene.grasp_target, CELL, planner)
    at = place_on_atlas(scene.points[triples], scene.normals[triples], problem, assignments(3))
    loads = loads_on(at, problem)
    margin = margins(scene.points[triples], scene.normals[triples], planner.friction)
    borne = at.triple[loads >= SETTINGS.least_load] // 6
    firm = {tuple(triples[k]) for k in borne if margin[k] >= planner.closure_margin}
    assert firm
    assert firm <= kept
    assert len(kept) < 0.5 * len(triples)


@pytest.mark.parametrize("kind", ["processes", pytest.param("ray", marks=pytest.mark.slow)])
def test_two_workers_make_the_same_files(kind, made, tmp_path):
    if kind == "ray":
        ray = pytest.importorskip("ray")
        ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    generate(SETTINGS, tmp_path / "two", Backend(kind, 2))
    if kind == "ray":
        ray.shutdown()
    assert hashes(tmp_path / "two") == hashes(made)
    one, two = (json.loads((f / "manifest.json").read_text()) for f in (made, tmp_path / "two"))
    assert one == two


def test_cut_off_and_missing_files_are_refused_and_made_again(made, tmp_path):
    folder = copied(made, tmp_path)
    shard = sorted((folder / "grasps").iterdir())[3]
    shard.write_bytes(shard.read_bytes()[:-100])
    with refused("cut off"):
        read_dataset(folder)
    assert typed(f"dataset info {folder}") == 2
    (folder / "poses").rename(tmp_path / "poses")
    with refused(r"missing|cut off"):
        summary(folder)
    generate(SETTINGS, folder)
    assert hashes(folder) == hashes(made)


def test_other_settings_in_the_folder_are_refused(made, tmp_path):
    other = DatasetSettings.of(["gelatin_box"], grasps_per_pose=7, chunk=3, seed=5)
    with refused("grasps_per_pose: 6 there, 7 now"):
        generate(other, made)
    with refused("holds no dataset"):
        read_manifest(tmp_path)


def test_a_cell_is_found_from_anywhere_and_no_other_is_taken_for_it(made, tmp_path, monkeypatch):
    file = tmp_path / "cell.yaml"
    file.write_text("schema: 1\nname: mine\n")
    monkeypatch.chdir(tmp_path)
    settings = DatasetSettings.of(["gelatin_box"], grasps_per_pose=6, chunk=3, seed=5, robot="cell.yaml")
    assert settings.as_json()["robot"] == str(file)
    folder = copied(made, tmp_path)
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["settings"]["robot"] = str(file)
    (folder / "manifest.json").write_text(json.dumps(manifest | {"cell": settings.cell.version}))
    assert check_sample(folder, 1)["checked"] == 1
    file.write_text("schema: 1\nname: mine\ntable_height: 0.01\n")
    with refused("is of cell 'mine-.*': this is 'mine-.*', give its own with --robot"):
        check_sample(folder, 1)
    with refused("cell: mine-.* there, mine-.* now"):
        generate(settings, folder)


def copied(made, tmp_path):
    shutil.copytree(made, tmp_path / "copy")
    return tmp_path / "copy"


def rewrite(path, **changes):
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    np.savez_compressed(path, **(arrays | changes))


@pytest.mark.parametrize("complete_before", [True, False])
def test_a_changed_shard_is_never_blessed(made, tmp_path, complete_before):
    folder = copied(made, tmp_path)
    shard = sorted((folder / "grasps").iterdir())[2]
    with np.load(shard) as file:
        forces = file["forces"]
    rewrite(shard, forces=2.0 * forces)
    if not complete_before:
        manifest = json.loads((folder / "manifest.json").read_text())
        del manifest["files"]
        manifest["complete"] = False
        (folder / "manifest.json").write_text(json.dumps(manifest))
    else:
        with refused(r"cut off|changed"):
            read_dataset(folder)
    generate(SETTINGS, folder)
    assert hashes(folder) == hashes(made)


def test_workers_end_with_a_parent_that_is_killed():
    code = (
        "import os, time\n"
        "from dexgrasp.runs.pool import Backend, run_pool\n"
        "def work(_):\n"
        "    print(os.getpid(), flush=True); time.sleep(60)\n"
        "list(run_pool(work, range(2), Backend(workers=2)))\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    worker = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    until = time.monotonic() + 10
    while alive(worker) and time.monotonic() < until:
        time.sleep(0.05)
    assert not alive(worker)


def alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_info_prints_json(made, printed):
    assert typed(f"dataset info {made} --json") == 0
    figures = printed()
    assert figures["grasps"] == 36
    assert figures["triples_feasible"] < figures["triples_decided"]
    assert sum(figures["margin_histogram"].values()) == 36
