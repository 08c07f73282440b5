"""The agents that need no planning, and how agents are made."""

import base64
import json
import os
import pathlib
import pickle
import subprocess
import sys
import zipfile

import gymnasium as gym
import numpy as np
import pytest
import trimesh
from lift_envs import finished
from numpy.testing import assert_array_equal
from processes import python
from refusals import refused
from robots import HOME, ROBOT
from tables import mistakes

from dexgrasp import make_agent
from dexgrasp.agents.hardcoded import HardcodedAgent
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
    observation, _ = env.reset(seed=seed)
    agent.reset(surface_cloud(env, observation, seed), {})
    return finished(env, agent, observation, 160)


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


def test_hardcoded_says_why_it_stands_still():
    agent, seen = HardcodedAgent(), cloud_of_box(np.full(3, 0.3))
    for observation, reason in (
        (seen, "approach_blocked"),
        (cloud_of_box(np.array([0.04, 0.08, 0.1]), at=(1.1, 0.0)), "out_of_reach"),
        (seen | {"cloud_mask": np.zeros(400, bool)}, "no_cloud"),
        (cloud_of_box(np.array([0.0, 0.08, 0.1])), "cloud_has_no_volume"),
        (cloud_of_box(np.array([0.04, 0.08, 0.1])), None),
    ):
        agent.reset(observation, {})
        assert agent.report.failure == reason
        if reason:
            stands = normalise(HOME.astype(np.float32), ROBOT).astype(np.float32)
            assert_array_equal(agent.act(observation | {"joint_positions": HOME}), stands)


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


@pytest.mark.parametrize(("name", "message"), mistakes("agents"))
def test_unknown_agents_name_what_is_valid(name, message):
    with refused(message):
        make_agent(name)


def test_a_checkpoint_acts_and_is_told_by_a_file_beside_it(tmp_path):
    library = pytest.importorskip("stable_baselines3")
    env = gym.make("DexGrasp/Lift-v2", objects="lego")
    path = tmp_path / "learned.zip"
    trained = library.SAC("MultiInputPolicy", env, device="cpu", buffer_size=10).learn(2)
    trained.save(path)
    for spec in (path, f"sac:{path}"):
        agent = make_agent(spec)
        observation, _ = env.reset(seed=0)
        agent.reset(observation, {})
        assert_array_equal(agent.act(observation), trained.predict(observation, deterministic=True)[0])
    assert make_agent(path, env_kwargs=["observe=reset"]).env_settings["observe"] == "reset"
    path.with_suffix(".json").write_text('{"observe": "reset"}')
    with refused("learned.json has .*no record of save_checkpoint"):
        make_agent(path)


def saved_ppo(env, path):
    library = pytest.importorskip("stable_baselines3")
    library.PPO("MultiInputPolicy", env, n_steps=2, batch_size=2, device="cpu").save(path)
    return make_agent(path)


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
        return json.loads(python(ask, cwd=tmp_path, env=surroundings))

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


EVALUATE = "-m dexgrasp.cli.main evaluate --agents late:Late --objects pear --trials 1 --out run"
READS_LATE = """
import os, runpy, numpy as np
from dexgrasp.agent import Agent
class Late(Agent):
    env_settings = {"obs_mode": "state", "control_mode": "joint_delta"}
    def reset(self, observation, info): self.gain = runpy.run_path("gain.py")["GAIN"]
    def act(self, observation): return np.full(23, self.gain * float(open(os.path.abspath("weights.txt")).read()))
"""


@pytest.mark.parametrize("changed", ["gain.py", "weights.txt"])
def test_what_an_agent_reads_while_it_acts_counts(tmp_path, monkeypatch, changed):
    monkeypatch.chdir(tmp_path)
    for name, text in {"late.py": READS_LATE, "gain.py": "GAIN = 0.1", "weights.txt": "0.5"}.items():
        (tmp_path / name).write_text(text)

    def evaluated():
        return subprocess.run([sys.executable, *EVALUATE.split()], capture_output=True, text=True)

    assert evaluated().returncode == evaluated().returncode == 0
    (tmp_path / changed).write_text((tmp_path / changed).read_text() + " ")
    again = evaluated()
    assert again.returncode == 2
    assert f"read {changed} while it acted, and that has changed since: choose another --out" in again.stderr


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
