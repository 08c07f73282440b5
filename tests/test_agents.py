"""The agents that need no planning, and how agents are made."""

import base64
import json
import os
import pathlib
import pickle
import subprocess
import sys
import textwrap
import zipfile

import gymnasium as gym
import numpy as np
import pytest
import trimesh
from numpy.testing import assert_array_equal
from refusals import refused
from robots import HOME, ROBOT

import dexgrasp_env  # noqa: F401
from dexgrasp import Agent, make_agent
from dexgrasp.agent import public_info
from dexgrasp.agents.hardcoded import HardcodedAgent, short_axis
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.poses import quat_to_matrix
from dexgrasp_env.robot.cell import make_cell
from dexgrasp_env.tasks.control import normalise


def surface_cloud(env, observation, seed=0):
    """Points of the true surface, behind the keys that perception fills."""
    simulation = env.unwrapped.simulation
    points, _ = trimesh.sample.sample_surface(simulation.object.mesh, 1024, seed=seed)
    pose = simulation.data.qpos[23:30]
    points = points @ quat_to_matrix(pose[3:]).T + pose[:3]
    return observation | {"cloud": points.astype(np.float32), "cloud_mask": np.ones(1024, np.int8)}


def play(agent, name, seed):
    env = gym.make("DexGrasp/Lift-v2", objects=name, control_mode="joint_position")
    observation, info = env.reset(seed=seed)
    agent.reset(surface_cloud(env, observation, seed), {})
    for _ in range(160):
        observation, _, terminated, _, info = env.step(agent.act(observation))
        if terminated or info["is_success"]:
            break
    env.close()
    return info


@pytest.mark.parametrize("name", ["sugar_box", "tomato_soup_can", "chips"])
def test_hardcoded_lifts_boxes_and_cans(name):
    agent = make_agent("hardcoded")
    outcomes = [play(agent, name, seed)["is_success"] for seed in range(2)]
    assert all(outcomes)
    assert agent.report.failure is None
    assert agent.report.planning_seconds < 10


def test_hardcoded_completed_is_given_the_side_that_no_camera_saw():
    agent = make_agent("hardcoded_completed")
    env = gym.make("DexGrasp/LiftOneView-v2", objects="sugar_box", **agent.env_settings)
    observation, _ = env.reset(seed=0)
    scene, middle = Scene.of_observation(observation), env.unwrapped.simulation.object_pose()[:2]
    seen, completed = (points[:, :2].mean(0) for points in (scene.target.points, agent._points(scene)))
    agent.reset(observation, {})
    env.close()
    assert np.linalg.norm(completed - middle) < 0.5 * np.linalg.norm(seen - middle)
    assert agent.report.failure is None


def cloud_of_box(size, yaw=0.0, at=(0.5, 0.0)):
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (400, 3)) * size
    points = points @ trimesh.transformations.rotation_matrix(yaw, [0, 0, 1])[:3, :3].T
    points += [*at, size[2] / 2]
    return {
        "cloud": points.astype(np.float32),
        "cloud_mask": np.ones(400, np.int8),
        "joint_targets": HOME.astype(np.float32),
    }


@pytest.mark.parametrize("yaw", [-1.2, 0.0, 0.4, 1.5])
def test_short_axis_follows_the_yaw(yaw):
    axis = short_axis(cloud_of_box(np.array([0.2, 0.05, 0.1]), yaw)["cloud"].astype(float))
    assert abs(axis @ [-np.sin(yaw), np.cos(yaw), 0]) > 0.99


def test_hardcoded_says_why_it_stands_still():
    agent = HardcodedAgent()
    observation = cloud_of_box(np.array([0.3, 0.3, 0.3]))
    agent.reset(observation, {})
    assert agent.report.failure == "approach_blocked"
    assert_array_equal(agent.act(observation), normalise(HOME.astype(np.float32), ROBOT).astype(np.float32))
    agent.reset(cloud_of_box(np.array([0.04, 0.08, 0.1]), at=(1.1, 0.0)), {})
    assert agent.report.failure == "out_of_reach"
    agent.reset(observation | {"cloud_mask": np.zeros(400, np.int8)}, {})
    assert agent.report.failure == "no_cloud"
    agent.reset(cloud_of_box(np.array([0.0, 0.08, 0.1])), {})
    assert agent.report.failure == "cloud_has_no_volume"
    agent.reset(cloud_of_box(np.array([0.04, 0.08, 0.1])), {})
    assert agent.report.failure is None


def test_hardcoded_plans_for_hands_that_its_postures_are_not_of():
    cell, agent = make_cell("panda_gripper"), HardcodedAgent()
    observation = cloud_of_box(np.array([0.04, 0.08, 0.1])) | {"joint_targets": cell.robot.home}
    agent.reset(observation, {"cell": cell})
    assert agent.report.failure is None


def test_hardcoded_without_a_cloud_or_a_reset_is_a_users_mistake():
    with refused("pointcloud"):
        HardcodedAgent().reset({"joint_targets": HOME}, {})
    with refused("call reset"):
        HardcodedAgent().act({"joint_targets": HOME})


def test_the_info_of_a_reset_has_all_that_agents_are_told():
    env = gym.make("DexGrasp/Lift-v2", objects="lego", observe="clear", obs_mode="pointcloud")
    _, info = env.reset(seed=0)
    told = public_info(env, info)
    assert told.keys() <= info.keys()
    assert info["cell"] is told["cell"] is env.unwrapped.settings.cell
    assert info["observe"] == "clear"
    assert "cell" not in env.step(env.action_space.sample())[4]
    env.close()


def test_random_is_seeded_and_fills_the_space():
    agent = make_agent("random")
    space = gym.spaces.Box(-1.0, 1.0, (22,), np.float32)
    agent.reset({}, {"action_space": space})
    draws = []
    for _ in range(2):
        agent.seed(3)
        draws.append([agent.act({}) for _ in range(50)])
    assert_array_equal(*draws)
    assert all(space.contains(action) for action in draws[0])
    assert np.ptp(draws[0]) > 1.9


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nobody", "valid are random, hardcoded"),
        ("no.such.module:Thing", "no.such.module"),
        ("dexgrasp.agent:Nothing", "no class 'Nothing'"),
        (":Thing", "cannot be imported"),
        ("fractions:Fraction", r"no method reset\(\)"),
        ("nothing.zip", "does not exist"),
        ("dqn:nothing.zip", "valid are ppo"),
        ("~nosuchuser/policy", "no such user"),
    ],
)
def test_unknown_agents_name_what_is_valid(name, message):
    with refused(message):
        make_agent(name)


def test_a_users_class_in_the_current_directory(tmp_path, monkeypatch):
    (tmp_path / "users_own_agent.py").write_text(
        textwrap.dedent("""
        class Still:
            def reset(self, observation, info):
                pass
            def act(self, observation):
                return observation["zero"]
        """)
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    agent = make_agent("users_own_agent:Still")
    agent.seed(0)
    assert not isinstance(agent, Agent)
    assert dict(agent.env_settings) == {}
    assert agent.report.failure is None
    assert agent.act({"zero": 0}) == 0


def test_a_checkpoint_acts_and_is_told_by_a_file_beside_it(tmp_path):
    library = pytest.importorskip("stable_baselines3")
    env = gym.make("DexGrasp/Lift-v2", objects="lego")
    path = tmp_path / "learned.zip"
    trained = library.SAC("MultiInputPolicy", env, device="cpu", buffer_size=10)
    trained.save(path)
    for spec in (str(path), f"sac:{path}"):
        agent = make_agent(spec)
        observation, _ = env.reset(seed=0)
        agent.reset(observation, {})
        assert_array_equal(agent.act(observation), trained.predict(observation, deterministic=True)[0])
    assert make_agent(str(path), env_kwargs=["observe=reset"]).env_settings["observe"] == "reset"
    path.with_suffix(".json").write_text('{"observe": "reset"}')
    with refused("learned.json is no record of save_checkpoint"):
        make_agent(str(path))


def test_not_a_checkpoint(tmp_path):
    (tmp_path / "policy.zip").write_text("no zip")
    with refused("not a checkpoint"):
        make_agent(str(tmp_path / "policy.zip"))


@pytest.mark.parametrize(
    "settings",
    [
        {"control_mode": "ee_delta", "obs_mode": "state"},
        {"control_mode": "joint_delta", "obs_mode": "state+pointcloud", "observe": "reset"},
    ],
)
def test_a_checkpoint_tells_its_modes_and_brings_its_normalisation(settings, tmp_path):
    library = pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.vec_env import VecNormalize

    from dexgrasp.learning.reinforcement.sb3_vec_env import SB3VecEnv

    env = VecNormalize(
        SB3VecEnv("DexGrasp/Lift-v2", 2, objects="lego", **settings), norm_obs_keys=["palm_pose"]
    )
    trained = library.PPO("MultiInputPolicy", env, n_steps=2, batch_size=2, n_epochs=1, device="cpu")
    trained.learn(4)
    trained.save(tmp_path / "ppo.zip")
    env.save(tmp_path / "vecnormalize.pkl")
    agent = make_agent(str(tmp_path / "ppo.zip"))
    assert agent.env_settings == {key: settings[key] for key in ("control_mode", "obs_mode")}
    alone = gym.make("DexGrasp/Lift-v2", objects="lego", **settings)
    observation, _ = alone.reset(seed=0)
    agent.reset(observation, {})
    expected = trained.predict(env.normalize_obs(observation), deterministic=True)[0]
    assert_array_equal(agent.act(observation), expected)
    (tmp_path / "ppo.pkl").write_bytes(b"no pickle")
    with refused("VecNormalize"):
        make_agent(str(tmp_path / "ppo.zip"))


def saved_ppo(env, path):
    library = pytest.importorskip("stable_baselines3")
    library.PPO("MultiInputPolicy", env, n_steps=2, batch_size=2, device="cpu").save(path)
    return make_agent(str(path))


def test_a_checkpoint_is_given_the_keys_that_it_was_trained_with(tmp_path):
    whole = gym.make("DexGrasp/Lift-v2", objects="lego")
    env = gym.wrappers.FilterObservation(whole, ["object_pose", "palm_pose"])
    agent, (observation, _) = saved_ppo(env, tmp_path / "ppo.zip"), whole.reset(seed=0)
    assert whole.action_space.contains(agent.act(observation))
    other = gym.spaces.Dict({"object_pose": whole.observation_space["object_pose"]})
    with refused("trained on observations palm_pose .*, here they are of object_pose"):
        agent.check_info({"observation_space": other})


READS = """
import importlib, json, os, sys
from pathlib import Path
helps = importlib.import_module("helps_" + "late")
with open(Path(__file__).parent / "weights" / f"{json.load(open('kind.json'))}.bin", "rb") as file:
    WEIGHTS = file.read()
class Reads:
    def __init__(self):
        with open(os.environ["ELSEWHERE"]) as file:
            file.read()
        open("log.txt", "w").close()
    def reset(self, observation, info): pass
    def act(self, observation): return helps.action()
"""


def test_an_agent_rests_on_what_it_reads_under_whatever_name(tmp_path):
    texts = {
        "reads.py": READS,
        "kind.json": '"actor"',
        "weights/actor.bin": "old",
        "weights/other.bin": "",
        "elsewhere/part.txt": "old",
        "helps_late.py": "import numpy\ndef action(): return numpy.zeros(23)\n",
    }
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    ask = (
        "import json; from dexgrasp.evaluation.settings import EvaluationSettings as E; "
        "i = E.of(['reads:Reads'], ['pear']).identity(); print(json.dumps([i['code'], i['files']]))"
    )
    surroundings = os.environ | {"ELSEWHERE": str(tmp_path / "elsewhere/part.txt")}

    def identity():
        done = subprocess.run(
            [sys.executable, "-c", ask], cwd=tmp_path, env=surroundings, capture_output=True, text=True, check=True
        )  # fmt: skip
        return json.loads(done.stdout)

    before = identity()
    assert identity() == before  # whether modules are compiled by now or not
    named = {pathlib.Path(path).name for path in before[1]}
    assert {"actor.bin", "part.txt"} <= named
    assert not {"other.bin", "log.txt"} & named
    for changed in ("weights/actor.bin", "helps_late.py"):
        (tmp_path / changed).write_text(texts[changed].replace("zeros", "ones").replace("old", "new") + " ")
        after = identity()
        assert after != before
        before = after


READS_LATE = """
import runpy, numpy as np
from dexgrasp.agent import Agent
class Late(Agent):
    env_settings = {"obs_mode": "state", "control_mode": "joint_delta"}
    def reset(self, observation, info): self.gain = runpy.run_path("gain.py")["GAIN"]
    def act(self, observation): return np.full(23, self.gain * float(open("weights.txt").read()))
"""


@pytest.mark.parametrize("changed", ["gain.py", "weights.txt"])
def test_what_an_agent_reads_while_it_acts_counts(tmp_path, monkeypatch, changed):
    monkeypatch.chdir(tmp_path)
    for name, text in {"late.py": READS_LATE, "gain.py": "GAIN = 0.1", "weights.txt": "0.5"}.items():
        (tmp_path / name).write_text(text)
    words = [
        sys.executable,
        "-m",
        "dexgrasp.cli.main",
        "evaluate",
        "--agents",
        "late:Late",
        "--objects",
        "pear",
    ]

    def evaluated():
        return subprocess.run([*words, "--trials", "1", "--out", "run"], capture_output=True, text=True)

    assert evaluated().returncode == evaluated().returncode == 0
    (tmp_path / changed).write_text((tmp_path / changed).read_text() + " ")
    again = evaluated()
    assert again.returncode == 2
    assert f"{changed} while it acted, and that has changed since: choose another --out" in again.stderr


class Harm:
    """Unpickled, it leaves a file behind."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return pathlib.Path.touch, (self.path,)


@pytest.mark.parametrize("key", ["policy_class", "lr_schedule", "added"])
def test_checkpoints_run_nothing(key, tmp_path):
    saved_ppo(gym.make("DexGrasp/Lift-v2", objects="lego"), tmp_path / "ppo.zip")
    pickled = base64.b64encode(pickle.dumps(Harm(tmp_path / "done"))).decode()
    with zipfile.ZipFile(tmp_path / "ppo.zip") as old, zipfile.ZipFile(tmp_path / "bad.zip", "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "data":
                data = json.loads(content)
                data[key] = {":type:": "?", ":serialized:": pickled}
                content = json.dumps(data).encode()
            new.writestr(name, content)
    if key == "policy_class":
        with refused("might run code"):
            make_agent(f"ppo:{tmp_path / 'bad.zip'}")
    else:
        make_agent(f"ppo:{tmp_path / 'bad.zip'}")
    assert not (tmp_path / "done").exists()
