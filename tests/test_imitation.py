"""Cloned policies: what they look at, resuming to the same bits, numpy as torch, agents by their path."""

import json
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from refusals import refused
from robots import CELL
from tables import mistakes
from trainings import goes_on_to_the_same_bits

from dexgrasp.data.demonstrations.generate import generate
from dexgrasp.data.demonstrations.hdf5_formats import read_episodes
from dexgrasp.data.demonstrations.settings import DemoSettings
from dexgrasp.evaluation.settings import EvaluationSettings, plan_trials
from dexgrasp.evaluation.trial_runner import TrialRunner
from dexgrasp.learning.imitation.bc_policy import BcPolicy
from dexgrasp.learning.imitation.cloud_features import grip_features, observed_cloud
from dexgrasp.learning.imitation.cloud_grasp_policy import CloudGraspPolicy
from dexgrasp.learning.imitation.demonstrated_grasp import demonstrated_grasp, grasp_from_row, grasp_to_row
from dexgrasp.learning.imitation.demonstration_data import read_grips, read_steps
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.registry import make_agent
from dexgrasp_env.tasks.features import features, initial_scene

torch = pytest.importorskip("torch")
pytest.importorskip("minari")
from dexgrasp.learning.imitation.bc_network import BcNet, GraspNet  # noqa: E402
from dexgrasp.learning.imitation.bc_training import VIEWS, BcTraining, StateBcTraining  # noqa: E402
from dexgrasp.learning.imitation.settings import BcNetSizes, BcSettings, GraspNetSizes  # noqa: E402
from dexgrasp.learning.training.checkpoint import read_state  # noqa: E402
from dexgrasp.learning.training.loop import CHECKPOINT  # noqa: E402
from dexgrasp.runs.weights import read_policy  # noqa: E402

SMALL = BcNetSizes(hidden=24, layers=2)
NARROW = GraspNetSizes(local=8, cloud=12, width=24)


@pytest.fixture(scope="module")
def demos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demos") / "out"
    generate(DemoSettings.of(["sugar_box"], agent="hardcoded", episodes=3, seed=3), folder)
    return folder


@pytest.fixture(autouse=True)
def short_epochs(monkeypatch):
    monkeypatch.setattr(BcTraining, "steps", 4)


def settings_of(view, **more):
    return BcSettings(
        view=view,
        epochs=2,
        episodes=2,
        rows=8,
        **({"network": SMALL} if view == "state" else {}),
        grasps=NARROW,
        **more,
    )


def test_features_tell_nothing_of_the_last_action(demos):
    episode = next(read_episodes(demos))
    seen = {key: array[40] for key, array in episode.observations.items()}
    scene = initial_scene(seen)
    faster = seen | {
        "joint_velocities": seen["joint_velocities"] + 1.0,
        "joint_positions": seen["joint_positions"] - 0.1,
    }
    assert_array_equal(*(features(scene, look, 40) for look in (seen, faster)))


def test_chunks_are_the_set_points_to_come_and_stand_still_at_the_end(demos):
    rows = read_steps([demos])
    assert rows.control_mode == "joint_delta"
    episode = next(read_episodes(demos))
    targets = episode.observations["joint_targets"]
    chunk = rows.batch(np.array([0]), np.array([[10, len(episode) - 2]]), 8).chunks[0]
    assert_allclose(chunk[0], targets[11:19] - targets[10], atol=1e-6)
    assert_allclose(chunk[1, 1:], np.repeat((targets[-1] - targets[-3])[None], 7, 0), atol=1e-6)


@pytest.mark.parametrize("view", ["state", "cloud"])
def test_training_goes_on_to_the_same_bits_and_gives_an_agent(demos, tmp_path, view):
    settings = settings_of(view)
    assert goes_on_to_the_same_bits(partial(VIEWS[view], [demos], settings), tmp_path).epoch == 2
    with refused("other settings"):
        VIEWS[view]([demos], settings_of(view, seed=1), tmp_path / "parts").run()
    agent = make_agent(tmp_path / "whole")
    assert agent.env_settings["obs_mode"] == {"state": "state", "cloud": "pointcloud"}[view]
    evaluation = EvaluationSettings.of([str(tmp_path / "whole")], ["sugar_box"], trials=1)
    assert any(name.endswith("policy.safetensors") for name in evaluation.identity()["files"])
    row, _ = TrialRunner(evaluation).run(plan_trials(evaluation)[0])
    assert row["error"] is None
    assert row["steps"] > 0


def trained(net, folder):
    """Return a network with what a training has learned."""
    note = read_state(folder / CHECKPOINT, {"net": net, "adam": torch.optim.Adam(net.parameters())})
    assert note["progress"]["epoch"] == 2
    return net


def test_numpy_predicts_what_torch_does(demos, tmp_path):
    StateBcTraining([demos], settings_of("state"), tmp_path / "out").run()
    (about, arrays), rows = read_policy(tmp_path / "out"), read_steps([demos])
    batch = rows.batch(np.array([0]), np.array([[5, 50]]), 8)
    net = trained(BcNet(SMALL, *rows.features[:2], np.ones(8 * 23, np.float32)), tmp_path / "out")
    theirs = net(torch.from_numpy(batch.features)).detach().numpy()[0]
    ours = BcPolicy(about, arrays).predict(batch.features[0]).reshape(2, -1)
    assert_allclose(ours / arrays["unit"], theirs, atol=1e-4)


def test_numpy_weighs_grips_as_torch_does(demos, tmp_path):
    VIEWS["cloud"]([demos], settings_of("cloud"), tmp_path / "out").run()
    grips, azimuths = read_grips([demos]), np.array([0.0, 1.0, 4.0])
    points, numbers = grip_features(grips.clouds[0], azimuths)
    net = trained(GraspNet(NARROW, numbers, grips.rows), tmp_path / "out")
    ours = CloudGraspPolicy(*read_policy(tmp_path / "out")).predict(grips.clouds[0], azimuths)
    for one, other in zip(ours, net(*map(torch.from_numpy, (points, numbers))), strict=True):
        assert_allclose(one, other.detach().numpy(), atol=1e-4)


def test_the_grasp_of_a_demonstration_is_read_and_written(demos):
    episode, tree = next(read_episodes(demos)), robot_tree(CELL)
    grasp, look = demonstrated_grasp(episode, 0.0, CELL), observed_cloud(episode.once)
    thumb, *fingers = grasp.tips
    assert all(0.02 < np.linalg.norm(tip - thumb) < 0.2 for tip in fingers)
    assert np.linalg.norm(grasp.tips.mean(axis=0) - look.middle) < 0.05
    # What presses, presses inwards, and along the line of the grip most of all.
    line = np.array([np.cos(grasp.azimuth), np.sin(grasp.azimuth), 0.0])
    assert grasp.forces[0] @ line > 1.0
    assert all(force @ line < -0.5 for force in grasp.forces[1:])
    again = grasp_from_row(grasp_to_row(grasp, look.middle), look.middle, grasp.azimuth, tree)
    for a, b in zip(grasp, again, strict=True):
        assert_allclose(a, b, atol=1e-9)


def test_damaged_policies_are_refused(demos, tmp_path):
    out = tmp_path / "out"
    StateBcTraining([demos], settings_of("state"), out).run()
    about = json.loads((out / "policy.json").read_text())
    for key, value, says in mistakes("policies"):
        (out / "policy.json").write_text(json.dumps(about | {key: value}))
        with refused(says):
            make_agent(out)


@pytest.mark.parametrize("name", ["bc", "bc_cloud", "rl"])
def test_the_shipped_policies_lift(name):
    evaluation = EvaluationSettings.of([name], ["mustard_bottle"], trials=3, seed=5)
    runner = TrialRunner(evaluation)
    rows = [runner.run(spec)[0] for spec in plan_trials(evaluation)]
    runner.close()
    assert sum(row["success"] for row in rows) >= 2
    assert not any(row["error"] for row in rows)
