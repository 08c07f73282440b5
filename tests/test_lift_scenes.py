"""Lift-v2's scenes: what reset and info say, what makes them hard, what is drawn at random."""

import copy

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from lift_envs import make
from numpy.testing import assert_allclose
from robots import CELL, HOME, ROBOT
from tables import table

from dexgrasp_env.objects.load import load_object
from dexgrasp_env.scene.build import build_scene
from dexgrasp_env.tasks.control import max_step, normalise
from dexgrasp_env.tasks.randomisation import Variation, apply_variation


def test_info_has_one_type_each():
    env = make(obs_mode="pointcloud", observe="reset")
    _, first = env.reset(seed=0)
    _, _, _, _, later = env.step(np.zeros(23))
    assert {k: type(first[k]) for k in later} == {k: type(v) for k, v in later.items()}
    assert first.keys() - later.keys() == env.unwrapped.agent_info.keys()
    assert not any(value is None or isinstance(value, list) for value in first.values())


def test_cameras_look_again_once_the_arm_is_home():
    env = make(obs_mode="pointcloud", observe="clear", control_mode="joint_position")
    env.reset(seed=0)
    away = HOME.copy()
    away[0] += 0.2
    clouds = [env.step(normalise(q, ROBOT).astype(np.float32))[0]["cloud"] for q in [away] * 8 + [HOME] * 12]
    assert np.array_equal(clouds[3], clouds[7])  # the arm is on its way: nobody looks
    assert not np.array_equal(clouds[-1], clouds[7])
    assert not np.array_equal(clouds[-1], clouds[-2])


def test_randomised_values_are_told():
    ranges = table("ranges")
    env = make(randomisation=ranges, mass=2.0)
    observation, info = env.reset(seed=0)
    told = info["variation"]
    assert 3.0 <= told["mass"] <= 4.0
    for name in ("friction", "gain", "latency", "joint_noise"):
        assert ranges[name][0] <= told[name] <= ranges[name][1]
    assert_allclose(observation["variation"], list(told.values()), rtol=1e-6)
    model = env.unwrapped.model
    assert model.actuator_gainprm[0, 0] == pytest.approx(4500 * told["gain"])
    noise = observation["joint_positions"] - env.unwrapped.data.qpos[:23]
    assert 0.2 * told["joint_noise"] < noise.std() < 3 * told["joint_noise"]


def test_commands_come_late():
    late, prompt = make(randomisation={"latency": (0.02, 0.02)}).unwrapped, make().unwrapped
    commands = []
    for env in (late, prompt):
        env.reset(seed=0)
        action = np.zeros(23)
        action[7] = 0.2
        rows = [env._episodes.set_points(action[None], env.simulation)[0][0].copy() for _ in range(3)]
        commands.append(np.concatenate(rows)[:, 7])
    assert_allclose(commands[0][10:], commands[1][:-10], atol=1e-12)
    assert_allclose(commands[0][:10], HOME[7], atol=1e-12)
    assert_allclose(np.diff(commands[1]), 0.2 * max_step(ROBOT)[7] / 25, atol=1e-12)


def test_calibration_error_is_one_rigid_motion():
    errors = []
    for seed in range(2):
        believed, true = (
            make(obs_mode="depth", sensor="none", calibration=error).reset(seed=seed)[1][
                "perception_T_world_camera"
            ]
            for error in ({"position": 0.01, "rotation": 0.035}, None)
        )
        each = believed @ np.linalg.inv(true)
        assert_allclose(each, each[:1].repeat(4, 0), atol=1e-12)
        assert np.arccos((np.trace(each[0, :3, :3]) - 1) / 2) == pytest.approx(0.035)
        assert np.linalg.norm((each[0] @ [0.5, 0, 0, 1])[:3] - [0.5, 0, 0]) == pytest.approx(0.01)
        errors.append(each[0])
    assert not np.allclose(*errors)


@pytest.mark.parametrize("name", ["sugar_box", "tomato_soup_can", "massage_ball", "castle"])
def test_randomised_model_equals_a_freshly_compiled_one(name):
    variation = Variation(mass=1.3, friction=0.45, size=1.15)
    model = load_object(name)
    base = build_scene(model, CELL)
    written = copy.copy(base)
    apply_variation(written, base, variation, mujoco.MjData(base))
    larger = model.scaled(variation.size)
    fresh = build_scene(
        larger.with_mass(model.mass * variation.size**3 * variation.mass), CELL, friction=variation.friction
    )
    names = table("of_the_object")
    for field in names:
        a, b = getattr(written, field), getattr(fresh, field)
        assert_allclose(a, b, rtol=2e-4, atol=2e-6, err_msg=field)


@pytest.mark.parametrize("obs_mode", ["depth", "pointcloud"])
def test_images_come_in_the_order_of_the_views_and_infos_name_them(obs_mode):
    asked, seen = ("side_right", "front_left"), []
    for views in (asked, asked[::-1]):
        env = make(obs_mode=obs_mode, views=list(views), sensor="none")
        observation, info = env.reset(seed=0)
        assert info["perception_cameras"] == views
        seen.append((observation, info))
    (a, about_a), (b, about_b) = seen
    for key in ("perception_T_world_camera", "perception_intrinsics"):
        assert_allclose(about_a[key], about_b[key][::-1])
    if obs_mode == "depth":
        assert_allclose(a["depth"], b["depth"][::-1])
        assert not np.array_equal(a["depth"], b["depth"])
    envs = gym.make_vec(
        "DexGrasp/Lift-v2", num_envs=2, objects="sugar_box", obs_mode=obs_mode, views=list(asked)
    )
    assert envs.reset(seed=0)[1]["perception_cameras"].tolist() == [asked] * 2
