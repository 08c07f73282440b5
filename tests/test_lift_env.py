"""Lift-v1 against its contract: spaces, determinism, resets, options, randomisation, bad input."""

import copy
import importlib.util
import json
import os
import pickle
import re
import subprocess
import sys
import warnings
from pathlib import Path

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.load import load_object
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.rendering import choose_gl
from dexgrasp_env.robot.limits import HOME, LOWER, UPPER
from dexgrasp_env.scene.build import build_scene
from dexgrasp_env.tasks import control
from dexgrasp_env.tasks.control import ACTION_SIZE, CONTROL_MODES, MAX_STEP
from dexgrasp_env.tasks.lift import LiftEnv
from dexgrasp_env.tasks.observations import OBS_MODES
from dexgrasp_env.tasks.randomisation import Variation, apply_variation
from dexgrasp_env.tasks.rewards import REWARD_MODES, WEIGHTS
from dexgrasp_env.tasks.simulation import Simulation

ID = "DexGrasp/Lift-v1"
NEEDS_GL = {"rgbd"}


def make(**kwargs):
    return gym.make(ID, **{"objects": "sugar_box", **kwargs}, disable_env_checker=True)


def skip_without_gl(obs_mode):
    if obs_mode in NEEDS_GL and choose_gl() is None:
        pytest.skip("no GL library here")


def rollout(env, seed, steps=25, scale=0.5, options=None):
    """Observations, rewards and the last state of random actions."""
    rng = np.random.default_rng(seed)
    observation, _ = env.reset(seed=seed, options=options)
    seen, rewards = [observation], []
    for _ in range(steps):
        observation, reward, terminated, _, _ = env.step(rng.uniform(-scale, scale, env.action_space.shape))
        seen.append(observation)
        rewards.append(reward)
        if terminated:
            break
    return seen, rewards, env.unwrapped.simulation.data.qpos.copy()


def assert_same(first, second):
    for a, b in zip(first[0], second[0], strict=True):
        assert all(np.array_equal(a[key], b[key]) for key in a)
    assert first[1] == second[1]
    assert np.array_equal(first[2], second[2])


# -- the contract of Gymnasium and SB3 ---------------------------------------------------------------------------


# Cameras know nothing of control and reward: every pair of modes meets once, not every triple.
EVERY_MODE = [
    *(("state", control_mode, reward_mode) for control_mode in CONTROL_MODES for reward_mode in REWARD_MODES),
    *((obs_mode, "joint_delta", "dense") for obs_mode in OBS_MODES if obs_mode != "state"),
]


@pytest.mark.parametrize(("obs_mode", "control_mode", "reward_mode"), EVERY_MODE)
def test_checkers_accept_every_mode(obs_mode, control_mode, reward_mode):
    skip_without_gl(obs_mode)
    env = make(obs_mode=obs_mode, control_mode=control_mode, reward_mode=reward_mode).unwrapped
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*WARN.*(infinity|symmetric|-inf|inf).*")
        warnings.filterwarnings("ignore", message=".*not within|.*pixel|.*image|.*render")
        check_env(env, skip_render_check=True)
    sb3 = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sb3.check_env(env, warn=False, skip_render_check=True)
    env.close()


IDS = sorted(name for name in gym.registry if name.startswith("DexGrasp/"))


@pytest.mark.parametrize("name", IDS)
def test_every_id_is_deterministic_and_accepted(name):
    env, other = (gym.make(name, objects="gelatin_box", disable_env_checker=True) for _ in range(2))
    assert_same(rollout(env, 3, 6), rollout(other, 3, 6))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*(infinity|symmetric|not within|pixel|image|render).*")
        check_env(env.unwrapped, skip_render_check=True)
    sb3 = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sb3.check_env(env.unwrapped, warn=False, skip_render_check=True)


def test_registrations_know_how_long_disturbances_take():
    for name in IDS:
        env = gym.make(name, objects="sugar_box", disable_env_checker=True)
        assert gym.spec(name).max_episode_steps == 300 + env.unwrapped.disturbance_steps
        gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))


def test_renders():
    if choose_gl() is None:
        pytest.skip("no GL library here")
    env = make(render_mode="rgb_array", render_size=(120, 160))
    env.reset(seed=0)
    picture = env.render()
    assert picture.shape == (120, 160, 3)
    assert picture.dtype == np.uint8
    assert picture.std() > 10
    env.close()
    env = make(render_mode="depth_array", render_size=(120, 160))
    env.reset(seed=0)
    depth = env.render()
    assert depth.shape == (120, 160)
    assert depth.dtype == np.float32
    assert 0.3 < depth.min() < depth.max()
    env.close()


@pytest.mark.parametrize("obs_mode", OBS_MODES)
def test_same_seed_gives_the_same_rollout(obs_mode):
    skip_without_gl(obs_mode)
    settings = {
        "objects": "seen",
        "obs_mode": obs_mode,
        "randomisation": {"mass": (0.5, 1.5), "size": (0.9, 1.1)},
    }
    env, other = make(**settings), make(**settings)
    steps = 2 if obs_mode == "rgbd" else 8
    first = rollout(env, 3, steps)
    rollout(other, 5, steps)  # a different past
    assert_same(first, rollout(other, 3, steps))
    assert_same(first, rollout(env, 3, steps))
    assert not np.array_equal(first[2], rollout(env, 4, steps)[2])
    env.close()
    other.close()


def test_reset_restores_everything():
    env = make(randomisation={"mass": (0.5, 2.0), "friction": (0.3, 1.2), "size": (0.8, 1.2)})
    fresh = rollout(env, 7)
    simulation = env.unwrapped.simulation
    env.reset(seed=8)
    data = simulation.data
    data.qpos[:] += 0.01
    data.qvel[:], data.qfrc_applied[:], data.xfrc_applied[:], data.qacc_warmstart[:] = 1.0, 2.0, 3.0, 4.0
    data.time = 99.0
    mujoco.mj_step(simulation.model, data)
    assert_same(fresh, rollout(env, 7))


def test_reset_undoes_randomisation():
    varied = make(randomisation={"size": (0.8, 1.2), "mass": (0.5, 2.0), "gain": (0.5, 2.0)})
    for seed in range(3):
        varied.reset(seed=seed)
    simulation = varied.unwrapped.simulation
    simulation.vary(Variation())
    base = simulation.base
    for name in (
        "body_mass",
        "body_inertia",
        "geom_size",
        "geom_friction",
        "pair_friction",
        "geom_rbound",
        "bvh_aabb",
        "actuator_gainprm",
        "actuator_biasprm",
    ):
        np.testing.assert_array_equal(getattr(simulation.model, name), getattr(base, name), err_msg=name)


def test_spec_serialises():
    env = make(objects=["sugar_box", "soda"], control_mode="ee_delta", randomisation={"mass": [0.9, 1.1]})
    text = env.spec.to_json()
    json.loads(text)
    again = gym.make(gym.envs.registration.EnvSpec.from_json(text))
    assert again.unwrapped.settings == env.unwrapped.settings
    assert gym.spec(ID).max_episode_steps == 300


def test_pickles():
    env = make(control_mode="joint_position", friction=0.6).unwrapped
    copied = pickle.loads(pickle.dumps(env))
    assert copied.settings == env.settings
    assert_same(rollout(env, 1, steps=3), rollout(copied, 1, steps=3))


def test_import_is_light():
    heavy = ("torch", "numba", "OpenGL", "glfw", "mujoco")
    code = f"import sys, dexgrasp_env; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_making_an_environment_brings_no_torch():
    code = (
        "import sys, gymnasium, dexgrasp_env; env = gymnasium.make('DexGrasp/Lift-v1', objects='sugar_box');"
        "env.reset(seed=0); env.step(env.action_space.sample()); print('torch' in sys.modules, 'OpenGL' in sys.modules)"
    )
    # MuJoCo itself imports OpenGL where MUJOCO_GL is set, as tests that render set it.
    clean = {key: value for key, value in os.environ.items() if key not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=clean)
    assert done.stdout.split() == ["False", "False"]


# -- the page against the code ----------------------------------------------------------------------------------


def table(heading):
    """Rows of every table of a section of the class docstring."""
    section = re.search(rf"## {heading}.*?(?=\n    ## |\Z)", LiftEnv.__doc__, re.S).group(0)
    rows = [
        [cell.strip() for cell in line.strip().strip("|").split("|")]
        for line in section.splitlines()
        if "|" in line
    ]
    return [row for row in rows if not set(row[0]) <= {"-", " "} or row[0] == ""]


def test_page_lists_every_observation():
    rows = [row for row in table("Observation Space") if row[0].startswith("`")]
    for obs_mode in OBS_MODES:
        skip_without_gl(obs_mode)
        env = make(obs_mode=obs_mode)
        listed = {
            row[0].strip("`"): (row[1], row[2]) for row in rows if len(row) == 4 or f"`{obs_mode}`" in row[3]
        }
        actual = {key: (str(space.shape), str(space.dtype)) for key, space in env.observation_space.items()}
        assert listed == actual
        env.close()


def test_page_lists_actions():
    rows = [row for row in table("Action Space") if row[0].startswith("`")]
    assert {row[0].strip("`"): int(row[1]) for row in rows} == ACTION_SIZE
    for mode, size in ACTION_SIZE.items():
        assert make(control_mode=mode).action_space.shape == (size,)


def test_page_lists_rewards_and_arguments():
    rows = [row for row in table("Rewards") if row[0].startswith("`")]
    assert {row[0].strip("`"): float(row[1]) for row in rows} == WEIGHTS
    rows = [row for row in table("Arguments") if row[0].startswith("`")]
    import inspect

    arguments = inspect.signature(LiftEnv.__init__).parameters
    assert {row[0].strip("`"): row[1].strip("`") for row in rows} == {
        name: repr(parameter.default) for name, parameter in arguments.items() if name != "self"
    }


# -- bad input --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kwargs", "word"),
    [
        ({"obs_mode": "pixels"}, "pointcloud"),
        ({"control_mode": "torque"}, "ee_delta"),
        ({"reward_mode": "shaped"}, "sparse"),
        ({"mount": "sideways"}, "palm_normal"),
        ({"friction": -1.0}, "friction"),
        ({"friction": float("nan")}, "friction"),
        ({"objects": "suger_box"}, "sugar_box"),
        ({"objects": []}, "objects"),
        ({"objects": "nowhere.stl"}, "nowhere.stl"),
        ({"object_pose": {"z": (0, 1)}}, "yaw"),
        ({"object_pose": {"x": (1, 0)}}, "low <= high"),
        ({"object_pose": {"rest_pose": "best"}}, "likely"),
        ({"randomisation": {"mass": (-1, 1)}}, "positive"),
        ({"randomisation": {"colour": (0, 1)}}, "friction"),
        ({"randomisation": {"latency": (0, 0.2)}}, "0.05"),
        ({"mass": 0.0}, "mass"),
        ({"presentation": "lying"}, "upright"),
        ({"disturbance": "kicked"}, "pushed"),
        ({"disturbance": {"kind": "pushed", "size": -1}}, "size"),
        ({"disturbance": {"force": 1}}, "size"),
        ({"views": 5}, "1 to 4"),
        ({"views": ["front"]}, "front_left"),
        ({"views": []}, "one or more"),
        ({"calibration": {"position": float("nan")}}, "calibration"),
        ({"calibration": {"yaw": 1}}, "rotation"),
        ({"observe": "never"}, "reset"),
        ({"sensor": "perfect"}, "realistic"),
        ({"render_mode": "ascii"}, "rgb_array"),
    ],
)
def test_wrong_arguments_are_named_in_one_line(kwargs, word):
    with pytest.raises(InputError) as caught:
        LiftEnv(**{"objects": "sugar_box", **kwargs})
    assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def test_wrong_actions_and_options():
    env = make().unwrapped
    with pytest.raises(InputError, match="reset"):
        env.step(np.zeros(23))
    env.reset(seed=0)
    with pytest.raises(InputError, match="shape"):
        env.step(np.zeros(22))
    with pytest.raises(InputError, match="NaN"):
        env.step(np.full(23, np.nan))
    for options in ({"colour": 1}, {"object": "soda"}, {"object_pose": [0, 0, 1]}, {"object_pose": [0] * 7}):
        with pytest.raises(InputError):
            env.reset(options=options)


@pytest.mark.parametrize(
    ("position", "word"),
    [
        ((0.5, 0.0, 0.01), "into the table"),
        ((3.0, 0.0, 0.05), "over the table"),
        ((0.5, 0.0, -1.0), "into the table"),
        ((0.85, 0.4, 0.05), "reach"),
        ((1e300, 0.0, 0.05), "finite"),
        ((np.nan, 0.0, 0.05), "finite"),
        ((0.5, 0.0, 0.5), "in the way"),
        (("a", 0.0, 0.05), "7 finite numbers"),
    ],
)
def test_impossible_poses_are_refused(position, word):
    env = make().unwrapped
    if word == "in the way":
        env.reset(seed=0)
        position = env.data.site("palm").xpos.copy()
    with pytest.raises(InputError, match=word) as caught:
        env.reset(options={"object_pose": [*position, 1, 0, 0, 0]})
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="reset"):
        env.step(np.zeros(23))


def test_v0_says_what_follows_it():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(gym.error.DeprecatedEnv, match="Lift-v1"):
            gym.make("DexGrasp/Lift-v0")


# -- what reset and info say ------------------------------------------------------------------------------------


def test_reset_is_true_from_the_first_moment():
    env = make()
    pose = [0.5, 0.0, 0.3, 1, 0, 0, 0]
    observation, info = env.reset(seed=0, options={"object_pose": pose})
    vertices = env.unwrapped.simulation.hull
    lowest = (vertices @ env.unwrapped.data.body("object").xmat.reshape(3, 3)[2]).min()
    assert info["object_height"] == pytest.approx(env.unwrapped.data.qpos[25] + lowest, abs=1e-12)
    assert observation["progress"][0] == pytest.approx(info["object_height"], abs=1e-6)
    assert set(info["reward_terms"]) == set(WEIGHTS)
    assert info["reward_terms"]["reach"] > 0
    np.testing.assert_allclose(observation["palm_pose"][:3], env.unwrapped.data.site("palm").xpos, atol=1e-6)


def test_info_has_one_type_each():
    env = make(obs_mode="pointcloud", observe="reset")
    _, first = env.reset(seed=0)
    _, _, _, _, later = env.step(np.zeros(23))
    assert {k: type(v) for k, v in first.items()} == {k: type(v) for k, v in later.items()}
    assert not any(value is None or isinstance(value, list) for value in first.values())


@pytest.mark.parametrize("mode", ["state", "pointcloud", "depth"])
def test_observations_stay_in_their_space(mode):
    env = make(obs_mode=mode, views=["front_left", "side_right"] if mode == "depth" else 4)
    observation, _ = env.reset(seed=2)
    rng = np.random.default_rng(0)
    for _ in range(3):
        assert env.observation_space.contains(observation)
        observation, *_ = env.step(rng.uniform(-1, 1, 23))


def test_randomised_values_are_told():
    ranges = {
        "mass": (1.5, 2),
        "friction": (0.3, 0.5),
        "gain": (0.8, 0.9),
        "latency": (0.01, 0.04),
        "joint_noise": (0.01, 0.02),
    }
    env = make(randomisation=ranges, mass=2.0)
    observation, info = env.reset(seed=0)
    told = info["variation"]
    assert 3.0 <= told["mass"] <= 4.0
    for name in ("friction", "gain", "latency", "joint_noise"):
        assert ranges[name][0] <= told[name] <= ranges[name][1]
    np.testing.assert_allclose(observation["variation"], list(told.values()), rtol=1e-6)
    model = env.unwrapped.model
    assert model.actuator_gainprm[0, 0] == pytest.approx(4500 * told["gain"])
    noise = observation["joint_positions"] - env.unwrapped.data.qpos[:23]
    assert 0.2 * told["joint_noise"] < noise.std() < 3 * told["joint_noise"]


# -- harder scenes ----------------------------------------------------------------------------------------------


def test_commands_come_late():
    late, prompt = make(randomisation={"latency": (0.02, 0.02)}).unwrapped, make().unwrapped
    commands = []
    for env in (late, prompt):
        env.reset(seed=0)
        action = np.zeros(23)
        action[7] = 0.2
        rows = [env._episodes.set_points(slice(0, 1), action[None])[0][0].copy() for _ in range(3)]
        commands.append(np.concatenate(rows)[:, 7])
    np.testing.assert_allclose(commands[0][10:], commands[1][:-10], atol=1e-12)
    np.testing.assert_allclose(commands[0][:10], HOME[7], atol=1e-12)
    np.testing.assert_allclose(np.diff(commands[1]), 0.2 * MAX_STEP[7] / 25, atol=1e-12)


def test_upright_stands_as_built():
    env = make(objects=["chips", "massage_ball", "sandwich_side"], presentation="upright")
    for name, up in (("chips", 1.0), ("sandwich_side", 0.0)):
        env.reset(seed=0, options={"object": name})
        assert env.unwrapped.data.body("object").xmat[8] == pytest.approx(up, abs=0.02)
    env.reset(seed=0, options={"object": "massage_ball"})


def test_one_view_is_drawn_by_the_seed():
    env = make(obs_mode="depth", views=1, sensor="none")
    chosen = []
    for seed in range(6):
        observation, info = env.reset(seed=seed)
        assert observation["depth"].shape == (1, 120, 160)
        chosen.append(tuple(info["perception_T_world_camera"][0, :3, 3]))
        assert np.array_equal(env.reset(seed=seed)[0]["depth"], observation["depth"])
    assert len(set(chosen)) > 1


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
        np.testing.assert_allclose(each, each[:1].repeat(4, 0), atol=1e-12)
        assert np.arccos((np.trace(each[0, :3, :3]) - 1) / 2) == pytest.approx(0.035)
        assert np.linalg.norm((each[0] @ [0.5, 0, 0, 1])[:3] - [0.5, 0, 0]) == pytest.approx(0.01)
        errors.append(each[0])
    assert not np.allclose(*errors)


def test_options_place_the_object():
    env = make(objects=["sugar_box", "gelatin_box"])
    pose = [0.5, 0.1, 0.05, 1, 0, 0, 0]
    observation, info = env.reset(seed=0, options={"object": "gelatin_box", "object_pose": pose})
    assert info["object"] == "gelatin_box"
    np.testing.assert_allclose(observation["object_pose"][:2], [0.5, 0.1], atol=2e-3)


# -- control ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("control_mode", CONTROL_MODES)
def test_set_points_keep_range_and_velocity(control_mode):
    env = make(control_mode=control_mode).unwrapped
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    before = HOME.copy()
    for _ in range(40):
        env.step(rng.choice([-1.0, 1.0], env.action_space.shape))
        after = env.targets
        assert np.all(np.abs(after - before) <= MAX_STEP + 1e-12)
        assert np.all((after >= LOWER) & (after <= UPPER))
        before = after


def test_positions_and_actions_are_inverse():
    q = LOWER + np.random.default_rng(0).random((5, 23)) * (UPPER - LOWER)
    np.testing.assert_allclose(control.denormalise(control.normalise(q)), q, atol=1e-12)


def test_ee_delta_moves_the_palm():
    env = make(control_mode="ee_delta")
    start, _ = env.reset(seed=0)
    action = np.zeros(22, np.float32)
    action[6:] = control.normalise(HOME)[7:]
    action[2] = 0.4  # 10 mm a step
    for _ in range(10):
        observation, *_ = env.step(action)
    for _ in range(10):
        observation, *_ = env.step(action * (np.arange(22) > 5))
    moved = observation["palm_pose"][:3] - start["palm_pose"][:3]
    np.testing.assert_allclose(moved, [0, 0, 0.1], atol=0.01)


# -- endings ----------------------------------------------------------------------------------------------------


def test_object_lost_terminates():
    env = make()
    env.reset(seed=0, options={"object_pose": [0.5, 0.63, 0.1, 1, 0, 0, 0]})
    env.unwrapped.simulation.data.qvel[24] = 1.5  # pushed off the table
    for _ in range(60):
        _, _, terminated, truncated, info = env.step(np.zeros(23))
        if terminated:
            break
    assert terminated
    assert not truncated
    assert info["failure"] == "object_lost"
    with pytest.raises(InputError, match="reset"):
        env.step(np.zeros(23))


def test_diverged_simulation_terminates_with_zero_reward():
    env = make()
    env.reset(seed=0)
    env.unwrapped.simulation.data.qvel[25] = 1e12
    observation, reward, terminated, _, info = env.step(np.zeros(23))
    assert terminated
    assert info["failure"] == "simulation_diverged"
    assert reward == 0.0
    assert info["mujoco_warnings"]
    assert all(np.isfinite(value).all() for value in observation.values())
    assert env.reset(seed=0)[1]["mujoco_warnings"] == ""


def test_time_limit_truncates():
    env = gym.make(ID, objects="sugar_box", max_episode_steps=4, disable_env_checker=True)
    env.reset(seed=0)
    endings = [env.step(np.zeros(23))[2:4] for _ in range(4)]
    assert endings == [(False, False)] * 3 + [(False, True)]


# -- randomisation ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["sugar_box", "tomato_soup_can", "massage_ball", "castle"])
def test_randomised_model_equals_a_freshly_compiled_one(name):
    variation = Variation(mass=1.3, friction=0.45, size=1.15)
    model = load_object(name)
    base = build_scene(model)
    written = copy.copy(base)
    apply_variation(written, base, variation)
    larger = model.scaled(variation.size)
    fresh = build_scene(
        larger.with_mass(model.mass * variation.size**3 * variation.mass), friction=variation.friction
    )
    names = (
        "body_mass", "body_inertia", "body_ipos", "geom_size", "geom_pos", "geom_quat", "geom_friction",
        "geom_rbound", "geom_aabb", "pair_friction", "dof_invweight0", "body_invweight0", "body_subtreemass",
        "mesh_vert", "mesh_pos",
    )  # fmt: skip
    for field in names:
        a, b = getattr(written, field), getattr(fresh, field)
        np.testing.assert_allclose(a, b, rtol=2e-4, atol=2e-6, err_msg=field)


def test_randomised_episode_reports_its_object():
    env = make(randomisation={"mass": (1.5, 1.5), "size": (1.2, 1.2)})
    observation, _ = env.reset(seed=0)
    model: ObjectModel = load_object("sugar_box")
    np.testing.assert_allclose(observation["object_size"], model.extents * 1.2, rtol=1e-5)
    assert observation["object_mass"][0] == pytest.approx(model.mass * 1.5 * 1.2**3, rel=1e-5)


def test_model_is_compiled_once_and_never_written_to():
    env, other = make().unwrapped, make(randomisation={"size": (1.2, 1.2)}).unwrapped
    other.reset(seed=0)
    assert env.simulation.base is other.simulation.base
    fresh: Simulation = env.simulation
    np.testing.assert_array_equal(fresh.base.geom_size, build_like(fresh).geom_size)


def build_like(simulation):
    from dexgrasp_env.sensing.cameras import default_cameras

    return build_scene(simulation.object, cameras=default_cameras())


def test_drawn_places_stay_in_their_ranges():
    env = make(object_pose={"x": (0.45, 0.5), "y": (-0.05, 0.0), "yaw": (0.2, 0.2), "rest_pose": "likely"})
    for seed in range(4):
        observation, info = env.reset(seed=seed)
        x, y, _ = observation["object_pose"][:3]
        assert 0.44 < x < 0.51
        assert -0.06 < y < 0.01
        assert abs(info["object_height"]) < 2e-3


def test_short_soak():
    """`scripts/soak.py` is the long one."""
    path = Path(__file__).parents[1] / "scripts" / "soak.py"
    if not path.is_file():
        pytest.skip("not in a checkout")
    spec = importlib.util.spec_from_file_location("soak", path)
    soak = importlib.util.module_from_spec(spec)
    sys.modules["soak"] = soak
    spec.loader.exec_module(soak)
    found = soak.run(900, ["sugar_box", "massage_ball", "tetrahedron"], episode=30)
    assert found.steps == 900
    assert found.is_clean, found
    assert found.endings["dropped"] or found.endings["object_lost"]
