"""Objects with neighbours: scenes, what is judged of neighbours, what is seen of them."""

import gymnasium as gym
import numpy as np
import pytest
from refusals import refused
from tables import mistakes, table

from dexgrasp.evaluation.evaluate import evaluate
from dexgrasp.evaluation.report.build import write_report
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.evaluation.store import read_rows
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.poses import quat_multiply, rotate
from dexgrasp_env.tasks.arrangement import gap_between, outline
from dexgrasp_env.tasks.constants import TOPPLED

FEW = table("few_neighbours")
KINDS = {"Sparse": (0.02, 0.05), "Dense": (0.005, 0.02), "Heap": None}
HOME = np.zeros(23, np.float32)


def make(kind="Sparse", **more):
    return gym.make(f"DexGrasp/Clutter{kind}-v1", **{**FEW, **more})


def outlines(simulation):
    corners = [simulation.hull, *(model.solid.corners for model in simulation.neighbours)]
    return [outline(one, pose) for one, pose in zip(corners, simulation.poses(), strict=True)]


@pytest.mark.parametrize("kind", ["Sparse", "Dense"])
def test_neighbours_stand_still_at_the_gaps_that_are_asked_for(kind):
    env = make(kind, neighbours=5)
    for seed in range(3):
        _, info = env.reset(seed=seed)
        low, high = KINDS[kind]
        shapes = outlines(env.unwrapped.simulation)
        assert info["neighbours"] == 5
        assert len(shapes) == 6
        for k in range(1, 6):
            nearest = min(gap_between(shapes[k], other) for other in shapes[:k])
            assert low - 0.002 <= nearest <= high + 0.002
        before = env.unwrapped.simulation.poses()
        for _ in range(20):
            *_, info = env.step(HOME)
        assert np.abs(env.unwrapped.simulation.poses() - before).max() < 1e-3
        assert info["neighbours_moved"] < 1e-3
        assert info["neighbours_hit"] == info["neighbours_toppled"] == 0


def test_a_heap_lies_on_the_table_and_touches():
    env = make("Heap", neighbours=6)
    env.reset(seed=1)
    simulation = env.unwrapped.simulation
    shapes = outlines(simulation)
    assert min(gap_between(a, b) for a in shapes for b in shapes if a is not b) < 0.0
    assert simulation.data.contact.dist.min() > -0.002
    for _ in range(40):
        *_, info = env.step(HOME)
    assert info["neighbours_moved"] < 0.005
    with refused("object_pose"):
        env.reset(options={"object_pose": [0.5, 0, 0.1, 1, 0, 0, 0]})


def push_into(env):
    """Put a neighbour where a moving finger is, and step."""
    env.reset(seed=0)
    simulation = env.unwrapped.simulation
    tip = simulation.data.site("middle_tip").xpos
    simulation.data.qpos[30:33] = tip - np.array([0.0, 0.0, 0.08])
    simulation.data.qvel[29:32] = [0.0, 0.0, 8.0]  # it passes the finger and is gone within a control step
    infos = [env.step(HOME)[4] for _ in range(2)]
    return simulation, infos[-1]


def test_a_touch_between_control_steps_counts_as_a_hit():
    _, info = push_into(make())
    assert info["neighbours_hit"] == 1
    assert info["neighbours_hit_names"] in FEW["neighbour_objects"]
    assert info["neighbours_moved"] > 0.05
    assert not info["is_clean"]


def test_a_neighbour_that_falls_over_has_toppled():
    env = make()
    env.reset(seed=0)
    simulation = env.unwrapped.simulation
    half = 0.5 * (TOPPLED + 0.2)
    turn = np.array([np.cos(half), np.sin(half), 0.0, 0.0])
    quat = simulation.data.qpos[33:37]
    simulation.data.qpos[33:37] = quat_multiply(turn, quat)
    simulation.data.qpos[32] += 0.2
    assert env.step(HOME)[4]["neighbours_toppled"] == 1


@pytest.mark.parametrize("mask", ["true", "perceived"])
def test_neighbours_are_seen(mask):
    """Points of every neighbour are in the observation, and none of them are in the target's cloud."""
    env = make(obs_mode="pointcloud", mask=mask, neighbours=4)
    for seed in range(2):
        observation, info = env.reset(seed=seed)
        assert not info["perception_failure"]
        simulation = env.unwrapped.simulation
        scene = Scene.of_observation(observation, info)
        around = np.concatenate([cloud.points for cloud in (*scene.neighbours, scene.rest)])
        shapes = [simulation.object, *simulation.neighbours]
        seen = [_inside(around, model, pose) for model, pose in zip(shapes, simulation.poses(), strict=True)]
        own = [_inside(scene.target.points, *pair) for pair in zip(shapes, simulation.poses(), strict=True)]
        assert min(seen[1:]) >= 40
        assert own[0] > 0.9 * len(scene.target)
        assert max(own[1:]) == 0
        assert seen[0] <= 5


def _inside(points, model, pose):
    """How many points lie in the box of a model, 4 mm larger."""
    local = rotate(pose[3:] * [1, -1, -1, -1], points - pose[:3])
    low, high = model.solid.vertices.min(0) - 0.004, model.solid.vertices.max(0) + 0.004
    return int(((local >= low) & (local <= high)).all(1).sum())


@pytest.mark.parametrize(("given", "words"), mistakes("clutter"))
def test_bad_recipes_end_in_one_line(given, words):
    with refused(words):
        make(**given)


def test_an_evaluation_says_what_was_clean_moved_and_hit(tmp_path):
    settings = EvaluationSettings.of(["hardcoded"], ["pear"], trials=1, protocols=("clutter_sparse@mask",))
    agent = evaluate(settings, tmp_path)["agents"]["hardcoded"]
    (row,) = read_rows(tmp_path)
    assert isinstance(row["clean"], bool)
    assert row["moved"] >= 0.0
    assert row["hit"] == len(row["hit_names"])
    assert agent["clutter"]["clutter_sparse@mask"]["clean"]["successes"] == row["clean"]
    assert "Among neighbours" in write_report([tmp_path], tmp_path / "report")


def test_a_bin_stands_around_and_is_seen():
    env = make(bin=True, obs_mode="pointcloud", mask="true")
    observation, info = env.reset(seed=0)
    model, data = env.unwrapped.model, env.unwrapped.data
    near, far, _, left = (model.geom(f"bin_{k}").pos for k in range(4))
    places = env.unwrapped.simulation.poses()[: info["neighbours"] + 1, 0]
    assert ((places > near[0]) & (places < far[0])).all()
    walls = observation["around"][observation["around_labels"] != 0]
    assert (np.abs(np.abs(walls[:, 1]) - 0.385) < 0.015).sum() > 20
    data.qpos[30:33] = [0.5, left[1] - 0.03, 0.05]  # a neighbour thrown at a wall stays inside
    data.qvel[29:32] = [0.0, 1.0, 0.0]
    for _ in range(5):
        env.step(HOME)
    assert data.qpos[31] < left[1]
    with refused("bin"):
        make(obs_mode="pointcloud", mask="true").unwrapped.set_state(env.unwrapped.get_state())
