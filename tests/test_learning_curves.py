"""Learning curves over seeds: what every seed has, drawn with its range."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from dexgrasp_env.errors import InputError

pytest.importorskip("safetensors")
pytest.importorskip("matplotlib")
from safetensors.numpy import save_file

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scripts"))
import learning_curves


def training(folder, seed, successes, rate=0.001):
    folder.mkdir()
    curve = [{"epoch": k + 1, "loss": 1.0 / (k + 1), "success": s} for k, s in enumerate(successes)]
    progress = {"epoch": len(curve), "epochs": len(curve), "seconds": 60.0, "curve": curve}
    run = {"schema": 1, "settings": {"seed": seed, "rate": rate}, "trials": None}
    (folder / "training.json").write_text(json.dumps(run))
    note = {"dexgrasp": json.dumps({"progress": progress})}
    save_file({"x": np.zeros(1, np.float32)}, folder / "checkpoint.safetensors", note)
    return folder


def test_mean_and_range_of_what_every_seed_has(tmp_path):
    folders = [training(tmp_path / "0", 0, [None, 0.5, 1.0]), training(tmp_path / "1", 1, [0.1, 0.7])]
    runs = learning_curves.read_runs(folders)
    assert [one["seed"] for one in runs["seeds"]] == [0, 1]
    epochs, values = learning_curves.over_seeds(runs["seeds"], "success")
    assert epochs.tolist() == [2]
    assert values.tolist() == [[0.5], [0.7]]
    assert learning_curves.over_seeds(runs["seeds"], "return")[0].size == 0
    learning_curves.main(
        [*map(str, folders), "--figure", str(tmp_path / "c.png"), "--json", str(tmp_path / "c.json")]
    )
    assert json.loads((tmp_path / "c.json").read_text()) == runs
    assert (tmp_path / "c.png").read_bytes()[:4] == b"\x89PNG"


def test_trainings_of_other_settings_are_refused(tmp_path):
    folders = [training(tmp_path / "0", 0, [0.5]), training(tmp_path / "1", 1, [0.5], rate=0.1)]
    with pytest.raises(InputError, match="more than their seeds"):
        learning_curves.read_runs(folders)
