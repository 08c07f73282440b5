"""Data sets, environments and policies in the hands of LeRobot and robomimic: `READERS=PYTHON bash .ci/run`.

PYTHON is one that has them (`CONTRIBUTING.md`); their versions of numpy and pillow are older than ours.
"""

import json
import subprocess
import sys

import numpy as np
import pytest
from processes import typed
from tables import table

from dexgrasp.data.demonstrations.generate import generate
from dexgrasp.data.demonstrations.hdf5_formats import read_episodes
from dexgrasp.data.demonstrations.lerobot_format import write_lerobot
from dexgrasp.data.demonstrations.settings import DemoSettings

pytestmark = pytest.mark.readers
SIZES = table("policy_sizes")


@pytest.fixture(scope="module")
def settings():
    return DemoSettings.of(
        ["soda", "pear"], agent="dexgrasp.agents.teacher:Teacher", episodes=2, seed=5, chunk=2
    )


@pytest.fixture(scope="module")
def folder(settings, tmp_path_factory):
    folder = tmp_path_factory.mktemp("demos") / "out"
    generate(settings, folder, ("minari", "lerobot", "robomimic"))
    return folder


@pytest.fixture(scope="module", params=["states", "pictures"])
def data(request, settings, folder, tmp_path_factory):
    """Return the folder of a LeRobot data set."""
    if request.param == "states":
        return folder / "lerobot"
    drawn = list(read_episodes(folder))[:2]
    rng = np.random.default_rng(0)
    for episode in drawn:  # as cameras would have them; none is needed to read them
        size = len(episode) + 1
        episode.observations["rgb"] = rng.integers(0, 256, (size, 1, 96, 128, 3), dtype=np.uint8)
    write_lerobot(root := tmp_path_factory.mktemp("pictures") / "lerobot", settings, drawn)
    return root


def opened(root, **more):
    lerobot_dataset = pytest.importorskip("lerobot.datasets.lerobot_dataset")
    return lerobot_dataset.LeRobotDataset("local/demos", root=root, **more)


def test_lerobot_reads_every_frame(data):
    whole = opened(data)
    assert whole.meta.total_frames == len(whole)
    first, last = whole[0], whole[len(whole) - 1]
    assert first["observation.state"].shape == (23,)
    assert first["task"] == "lift soda"
    assert bool(last["next.success"])
    assert first["observation.environment_state"].shape == (17,)
    if "pictures" in str(data):
        assert first["observation.images.view_0"].shape == (3, 96, 128)


@pytest.mark.parametrize("kind", ["act", "diffusion"])
def test_lerobots_policies_train_on_it(kind, data):
    factory = pytest.importorskip("lerobot.policies.factory")
    import torch
    from lerobot.datasets.factory import resolve_delta_timestamps

    config = factory.make_policy_config(kind, device="cpu", push_to_hub=False, **SIZES[kind])
    config.pretrained_backbone_weights = None  # of a hub
    about = opened(data).meta
    policy = factory.make_policy(config, ds_meta=about)
    before, _ = factory.make_pre_post_processors(config, dataset_stats=about.stats)
    whole = opened(data, delta_timestamps=resolve_delta_timestamps(config, about))
    optimiser, losses = torch.optim.Adam(policy.parameters(), 1e-3), []
    batch = before(next(iter(torch.utils.data.DataLoader(whole, batch_size=8, shuffle=True))))
    for _ in range(8):
        loss, _ = policy.forward(dict(batch))
        losses.append(loss.item())
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    assert np.isfinite(losses).all()
    if kind == "act":
        assert losses[-1] < losses[0]


def test_lerobot_eval_and_evaluate_have_the_same_outcomes(folder, tmp_path):
    pytest.importorskip("lerobot")
    from lerobot.datasets.factory import resolve_delta_timestamps  # noqa: F401  (registers the data sets)
    from lerobot.policies.factory import make_policy, make_policy_config, make_pre_post_processors

    about, config = opened(folder / "lerobot").meta, make_policy_config("act", device="cpu", **SIZES["act"])
    policy, path = make_policy(config, ds_meta=about), tmp_path / "pretrained_model"
    policy.save_pretrained(path)
    for pipeline in make_pre_post_processors(config, dataset_stats=about.stats):
        pipeline.save_pretrained(path)
    script = "import sys; from lerobot.scripts.lerobot_eval import main; sys.argv[0] = 'lerobot-eval'; main()"
    options = [
        f"--policy.path={path}", "--policy.device=cpu", "--env.discover_packages_path=dexgrasp.learning.lerobot",
        "--env.type=dexgrasp", "--env.objects=soda,pear", "--env.render_mode=none", "--eval.n_episodes=2",
        "--eval.batch_size=1", "--seed=0", f"--output_dir={tmp_path / 'theirs'}",
    ]  # fmt: skip
    subprocess.run([sys.executable, "-c", script, *options], check=True, capture_output=True, timeout=1800)
    ask = (
        f"evaluate --agents lerobot:{path} --objects soda pear --trials 2 --seed 0 --out {tmp_path / 'ours'}"
    )
    assert typed(f"{ask} --env-kwargs control_mode=joint_delta") == 0
    theirs = json.loads((tmp_path / "theirs/eval_info.json").read_text())["per_task"]
    rows = [json.loads(line) for line in (tmp_path / "ours/trials.jsonl").read_text().splitlines()]
    ours = {(row["object"], row["trial"]): (row["success"], row["total_reward"]) for row in rows}
    for k, name in enumerate(("soda", "pear")):
        metrics = theirs[k]["metrics"]
        found = list(zip(metrics["successes"], metrics["sum_rewards"], strict=True))
        for trial, (success, total) in enumerate(found):
            assert success == ours[name, trial][0]
            assert total == pytest.approx(ours[name, trial][1], abs=1e-9)  # added in another order


def test_robomimic_reads_every_episode(folder):
    datasets = pytest.importorskip("robomimic.utils.dataset")
    from robomimic.utils import file_utils, obs_utils

    path, keys = str(folder / "robomimic/demos.hdf5"), ["object_pose", "joint_positions"]
    obs_utils.initialize_obs_utils_with_obs_specs([{"obs": {"low_dim": keys, "rgb": []}}])
    assert file_utils.get_env_metadata_from_dataset(path)["env_name"] == "DexGrasp/Lift-v2"
    assert file_utils.get_shape_metadata_from_dataset(path, all_obs_keys=keys)["ac_dim"] == 23
    whole = datasets.SequenceDataset(
        path, keys, ["actions", "rewards", "dones"], seq_length=10, filter_by_attribute="train"
    )
    assert whole.n_demos == len(list(read_episodes(folder)))
    assert len(whole) == sum(len(episode) for episode in read_episodes(folder))
    assert whole[3]["obs"]["object_pose"].shape == (10, 7)
