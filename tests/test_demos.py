"""Demonstrations: conversion between modes, noise that is known, data sets that others read, resuming."""

import json
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from processes import typed
from refusals import refused
from robots import CELL, HOME
from tables import mistakes, table

from dexgrasp.agents.hardcoded import HardcodedAgent
from dexgrasp.data.demonstrations import DemoResets
from dexgrasp.data.demonstrations import generate as generation
from dexgrasp.data.demonstrations.convert import to_action
from dexgrasp.data.demonstrations.generate import generate
from dexgrasp.data.demonstrations.hdf5_formats import read_episodes, write_robomimic
from dexgrasp.data.demonstrations.info import replay_all, summary
from dexgrasp.data.demonstrations.lerobot_format import write_lerobot
from dexgrasp.data.demonstrations.settings import DemoSettings
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp_env.files import read_json_object
from dexgrasp_env.objects.load import load_object, resolve_targets
from dexgrasp_env.tasks.constants import GOAL_STEPS

pytest.importorskip("minari")
TEACHER = "dexgrasp.agents.teacher:Teacher"


def test_varied_objects_are_the_same_by_number_and_differ_between_numbers():
    names = resolve_targets(["varied-3..6", "varied-4"])
    assert names == ["varied-3", "varied-4", "varied-5", "varied-6"]
    assert len({load_object(name).content_hash for name in names}) == 4
    with refused("varied-FIRST"):
        resolve_targets(["varied-6..3"])


@pytest.mark.parametrize(("mode", "scale"), table("paces"))
def test_actions_of_every_mode_follow_the_same_set_points(mode, scale):
    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box", control_mode=mode, action_scale=scale)
    env.reset(seed=0)
    tree = robot_tree(CELL)
    ways = np.array([0.3, 0.2, -0.1, 0.15, 0.1, 0.2, 0.3, *(0.1,) * 12, 0.02, *(0.1,) * 3])
    path = [HOME + ways * k / 20 for k in range(21)]
    for wanted in path[1:]:
        env.step(to_action(mode, env.unwrapped.targets, wanted, tree, scale))
    targets = env.unwrapped.targets
    assert_allclose(targets[7:], path[-1][7:], atol=1e-5)
    for reached, meant in zip(palm_frame(targets, tree), palm_frame(path[-1], tree), strict=True):
        assert_allclose(reached, meant, atol=2e-3 if mode == "ee_delta" else 1e-5)


@pytest.fixture(scope="module")
def settings():
    return DemoSettings.of(["sugar_box"], agent=TEACHER, episodes=2, noise=0.02, seed=3, chunk=1)


@pytest.fixture(scope="module")
def folder(settings, tmp_path_factory):
    folder = tmp_path_factory.mktemp("demos") / "out"
    assert generate(settings, folder, ("minari", "lerobot"))["episodes"] >= 1
    return folder


def test_the_data_set_is_minaris_and_replays(folder):
    import minari

    data = minari.MinariDataset(folder / "data")
    figures = summary(folder)
    assert data.total_episodes == figures["episodes"]
    assert data.total_steps == figures["steps"]
    episode = next(iter(data.iterate_episodes()))
    assert episode.observations["object_pose"].shape == (len(episode) + 1, 7)
    assert episode.actions.shape == (len(episode), 23)
    solved = episode.infos["is_success"].tolist().index(True)
    assert solved < len(episode) - 5  # it goes on to hold
    assert all(episode.infos["is_success"][solved:])
    assert episode.truncations.tolist() == [False] * (len(episode) - 1) + [True]
    assert replay_all(folder)["successes"] == figures["episodes"]
    assert data.recover_environment().unwrapped.settings.control_mode == "joint_delta"


@pytest.mark.parametrize(("observe", "most"), [("reset", 1), ("step", 0), ("clear", 4)])
def test_what_cameras_saw_along_demonstrations_is_kept_once_a_look(folder, observe, most):
    settings = {"objects": "sugar_box", "obs_mode": "state+depth", "views": 1, "observe": observe}
    env = gym.make_vec("DexGrasp/Lift-v2", num_envs=1, **settings)
    resets = DemoResets(folder, whole=0.0).attach(env)
    views = [state.view for state in resets.states[0]]
    assert len(views) > 20
    assert len({id(view) for view in views if view.seen}) <= most
    held, info = env.reset(seed=0)
    assert info["stage"] == ["lifted"]
    assert held["depth"].any()
    if observe == "reset":
        assert_array_equal(held["depth"][0], views[0].seen["depth"])


@pytest.mark.parametrize("control_mode", ["joint_delta", "ee_delta"])
def test_episodes_begin_along_demonstrations_backwards_from_success(folder, control_mode):
    settings = {"objects": ["sugar_box", "soda"], "control_mode": control_mode, "max_episode_steps": 4}
    envs = gym.make_vec("DexGrasp/Lift-v2", num_envs=4, autoreset_mode="SameStep", **settings)
    resets = DemoResets(folder, whole=0.0).attach(envs)
    demo, states = next(read_episodes(folder)), resets.states[0]
    assert len(states) == pytest.approx(len(demo) / 4, abs=4)
    assert_allclose(states[0].physics[24:31], demo.observations["object_pose"][0], atol=1e-3)
    envs.reset(seed=0)
    for _ in range(4):
        *_, info = envs.step(np.zeros(envs.action_space.shape))
    assert (info["final_info"]["object_height"] > 0.05).all()  # all of them began with the object in the hand
    single = gym.make("DexGrasp/Lift-v2", **settings, disable_env_checker=True)
    resets = DemoResets(folder, whole=0.0)
    resets._demos[0].observations["object_pose"][0, 2] -= 0.0015  # as what is round sinks into the table
    resets.attach(single)
    assert resets.states[0]
    single.reset(seed=0)
    assert single.unwrapped.observe()[1]["stage"] == "lifted"
    won = single.unwrapped._episodes.records[0].copy()
    for _ in range(300):  # where episodes succeed they begin further back, in the end at the beginning
        won["solved"] = True
        resets(0, np.random.default_rng(len(resets._recent)), won)
    assert resets.front < 0.9
    with refused("no demonstration"):
        DemoResets(folder).attach(gym.make("DexGrasp/Lift-v2", objects="soda", disable_env_checker=True))


def test_demonstrations_of_another_robot_are_refused(folder):
    resets = DemoResets(folder)
    resets._settings = replace(resets._settings, robot="panda_gripper")
    with refused("the demonstrations are of panda-.*: make some of its own"):
        resets.attach(gym.make("DexGrasp/Lift-v2", objects="sugar_box", disable_env_checker=True))


def test_what_is_brought_to_a_place_begins_along_them_with_their_end_as_goal(folder):
    env = gym.make("DexGrasp/Place-v2", objects=["sugar_box", "soda"], disable_env_checker=True)
    resets = DemoResets(folder, whole=0.0).attach(env)
    observation, _ = env.reset(seed=0)
    end = next(read_episodes(folder)).observations["object_pose"][-1, :3]
    assert_allclose(resets.states[0][0].task_record["goal"][:3], end, atol=1e-6)
    assert (
        observation["desired_goal"][3] == observation["achieved_goal"][3] == 1.0
    )  # in the hand, on its way there
    for steps, moves in ((0, False), (GOAL_STEPS - 1, False), (GOAL_STEPS, True)):
        for k in range(300):  # lifted, and where it is to be or not
            resets(0, np.random.default_rng(k), {"solved": True, "at_goal": steps})
        assert (resets.front < 0.9) is moves
    resets._demos[0].observations.pop("object_pose")
    with refused("say where they end"):
        resets.attach(env)


def test_the_lerobot_layout_holds_the_same_steps(folder):
    import pyarrow.parquet as pq

    info, stats = (
        json.loads((folder / f"lerobot/meta/{name}.json").read_text()) for name in ("info", "stats")
    )
    assert (info["codebase_version"], info["fps"]) == ("v3.0", 20)
    rows = pq.read_table(folder / "lerobot/data/chunk-000/file-000.parquet").to_pydict()
    assert set(info["features"]) == set(rows)
    assert rows["index"] == list(range(info["total_frames"]))
    episode = next(read_episodes(folder))
    first = np.array(rows["action"])[np.array(rows["episode_index"]) == 0]
    assert_array_equal(first.astype(np.float32), episode.actions)
    table = pq.read_table(folder / "lerobot/meta/episodes/chunk-000/file-000.parquet").to_pydict()
    assert table["length"][0] == len(episode)
    assert_array_equal(table["once/cloud"][0], episode.once["cloud"].ravel())
    assert_allclose(stats["action"]["mean"], np.mean(rows["action"], axis=0), atol=1e-6)
    tasks = pytest.importorskip("pandas").read_parquet(folder / "lerobot/meta/tasks.parquet")
    assert tasks.iloc[0].name == "lift sugar_box"


def test_an_interrupted_run_goes_on_to_the_same_demonstrations(settings, folder, tmp_path, monkeypatch):
    make, calls = generation.make, []

    def once(job, **given):
        if calls:
            raise KeyboardInterrupt
        calls.append(job)
        make(job, **given)

    monkeypatch.setattr(generation, "make", once)
    with pytest.raises(KeyboardInterrupt):
        generate(settings, tmp_path / "out")
    monkeypatch.setattr(generation, "make", make)
    with refused("not complete"):
        replay_all(tmp_path / "out")
    generate(settings, tmp_path / "out")
    for one, other in zip(read_episodes(folder), read_episodes(tmp_path / "out"), strict=True):
        assert_array_equal(one.actions, other.actions)
        assert_array_equal(one.observations["joint_positions"], other.observations["joint_positions"])
    with refused("other settings"):
        generate(DemoSettings.of(["sugar_box"], agent=TEACHER, episodes=3), tmp_path / "out")


class Hopeless(HardcodedAgent):
    """Has no plan, for one of two reasons."""

    def reset(self, observation, info):
        super().reset(observation, info)
        self.tried = getattr(self, "tried", 0) + 1
        self.report.failure = "no_grasp" if self.tried < 3 else "no_path"


def test_where_nothing_succeeds_it_is_said_why(tmp_path):
    settings = DemoSettings.of(["sugar_box"], agent=f"{__name__}:Hopeless", episodes=3)
    with refused("not one demonstration succeeded: no_grasp 2, no_path 1"):
        generate(settings, str(tmp_path))


def test_scenes_draw_what_is_asked_for_and_replays_draw_the_same(tmp_path):
    drawn = ("size", 0.6, 0.9), ("mass", 0.5, 2.0)
    settings = DemoSettings.of(["sugar_box"], agent=TEACHER, episodes=2, seed=3, randomise=drawn)
    assert (
        DemoSettings.of_json(json.loads(json.dumps(settings.as_json()))).env_arguments
        == settings.env_arguments
    )
    generate(settings, tmp_path)
    kept = list(read_episodes(tmp_path))
    assert replay_all(tmp_path)["successes"] == len(kept) > 0
    sizes = [demo.observations["object_size"][0].max() for demo in kept]
    whole = load_object("sugar_box").extents.max()
    assert all(0.6 * whole < size < 0.9 * whole for size in sizes)
    with refused("drawn sizes"):
        DemoResets(tmp_path)


@pytest.mark.parametrize(("wrong", "says"), mistakes("demonstrations"))
def test_wrong_settings_are_refused(wrong, says):
    with refused(says):
        DemoSettings.of(["sugar_box"], **wrong)


def test_the_command_line_tells_and_replays(folder, capsys, printed):

    assert typed(f"demos info {folder} --json") == 0
    figures = printed()
    assert figures["episodes"] == sum(figures["kept"].values())
    assert typed(f"demos replay {folder} --episodes 1") == 0
    assert "1 of 1 replays succeed" in capsys.readouterr().out


@pytest.mark.parametrize("once", [False, True])
def test_pictures_are_images_of_lerobot_and_described_by_colour(once, settings, folder, tmp_path):
    import imageio.v3 as iio
    import pyarrow.parquet as pq

    episode, rng = next(read_episodes(folder)), np.random.default_rng(0)
    pictures = rng.integers(0, 256, (len(episode) + 1, 2, 12, 16, 3), dtype=np.uint8)
    (episode.once if once else episode.observations)["rgb"] = pictures[0] if once else pictures
    write_lerobot(tmp_path / "lerobot", settings, [episode])
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
    write_robomimic(tmp_path / "robomimic", settings, episodes)
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
