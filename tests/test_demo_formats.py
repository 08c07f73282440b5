"""Demonstrations as the readers of LeRobot and Minari expect them."""
# ruff: noqa: F401, F811

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from test_demos import folder, settings

from dexgrasp.data.demonstrations.lerobot_format import write_lerobot
from dexgrasp.data.demonstrations.minari_format import read_episodes, write_minari
from dexgrasp.data.demonstrations.robomimic_format import write_robomimic
from dexgrasp.data.demonstrations.settings import DemoSettings
from dexgrasp_env.files import read_json_object


@pytest.mark.parametrize("once", [False, True])
def test_pictures_are_images_of_lerobot_and_described_by_colour(once, settings, folder, tmp_path):
    import imageio.v3 as iio
    import pyarrow.parquet as pq

    episode, rng = next(read_episodes(folder)), np.random.default_rng(0)
    pictures = rng.integers(0, 256, (len(episode) + 1, 2, 12, 16, 3), dtype=np.uint8)
    (episode.once if once else episode.observations)["rgb"] = pictures[0] if once else pictures
    write_lerobot(tmp_path, settings, [episode])
    info, stats = (read_json_object(tmp_path / f"lerobot/meta/{name}.json", "") for name in ("info", "stats"))
    assert info["features"]["observation.images.view_1"]["shape"] == [12, 16, 3]
    rows = pq.read_table(tmp_path / "lerobot/data/chunk-000/file-000.parquet").to_pylist()
    for k in (0, len(episode) - 1):
        kept = iio.imread(rows[k]["observation.images.view_1"]["bytes"])
        assert_array_equal(kept, pictures[0 if once else k, 1])
    assert np.shape(stats["observation.images.view_1"]["mean"]) == (3, 1, 1)
    assert 0.4 < np.mean(stats["observation.images.view_1"]["mean"]) < 0.6


def test_robomimic_finds_its_layout(settings, folder, tmp_path):
    import h5py

    episodes = list(read_episodes(folder))[:1] * 11
    write_robomimic(tmp_path, settings, episodes)
    with h5py.File(tmp_path / "robomimic/demos.hdf5") as file:
        about, first = json.loads(file["data"].attrs["env_args"]), file["data/demo_0"]
        steps = len(episodes[0])
        assert (about["env_name"], about["type"]) == ("DexGrasp/Lift-v2", 2)
        assert about["env_kwargs"]["objects"] == list(settings.objects)
        assert (file["data"].attrs["total"], first.attrs["num_samples"]) == (11 * steps, steps)
        assert_array_equal(first["actions"][:], episodes[0].actions)
        assert_array_equal(first["obs/object_pose"][1:], first["next_obs/object_pose"][:-1])
        assert_array_equal(first["next_obs/object_pose"][-1], episodes[0].observations["object_pose"][-1])
        assert list(first["dones"][:]) == [0] * (steps - 1) + [1]
        masks = {name: [each.decode() for each in file[f"mask/{name}"]] for name in ("train", "valid")}
    assert (masks["valid"], len(masks["train"])) == (["demo_9"], 10)
