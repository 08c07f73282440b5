"""Lift-v2 against its contract and its page: checkers, determinism, resets, control, endings, bad input."""

import ast
import re
import warnings
from dataclasses import fields

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from lift_envs import few, make, rollout, skip_without_gl
from numpy.testing import assert_equal
from refusals import refused
from robots import HOME, LOWER, ROBOT, UPPER
from tables import mistakes, table

from dexgrasp_env.rendering import choose_gl
from dexgrasp_env.robot.cell import default_cell
from dexgrasp_env.tasks.control import CONTROL_MODES, action_size, max_step
from dexgrasp_env.tasks.lift import LiftEnv
from dexgrasp_env.tasks.observations import OBS_MODES, OBS_SUMS
from dexgrasp_env.tasks.settings import WEIGHTS, LiftSettings

# Cameras, control and reward know nothing of each other.
EVERY_MODE = [
    *(("state", control_mode, "dense") for control_mode in CONTROL_MODES),
    ("state", "joint_delta", "sparse"),
    *(
        pytest.param(obs_mode, "joint_delta", "dense", marks=[pytest.mark.slow] * (obs_mode == "rgbd"))
        for obs_mode in OBS_MODES
        if obs_mode != "state"
    ),
]


def assert_accepted(env):
    """Both checkers: Gymnasium's without a warning but those about bounds and rendering, and SB3's."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*(infinity|symmetric|not within|pixel|image|render).*")
        check_env(env.unwrapped, skip_render_check=True)
    sb3 = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sb3.check_env(env.unwrapped, warn=False, skip_render_check=True)


@pytest.mark.parametrize(("obs_mode", "control_mode", "reward_mode"), EVERY_MODE)
def test_checkers_accept_every_mode(obs_mode, control_mode, reward_mode):
    skip_without_gl(obs_mode)
    env = make(obs_mode=obs_mode, control_mode=control_mode, reward_mode=reward_mode)
    assert_accepted(env)
    env.close()


IDS = sorted(name for name in gym.registry if name.startswith("DexGrasp/"))


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * ("Heap" in name)) for name in IDS]
)
def test_every_id_is_deterministic_and_accepted(name):
    env, other = (gym.make(name, objects="gelatin_box", disable_env_checker=True) for _ in range(2))
    assert_equal(rollout(env, 3, 6), rollout(other, 3, 6))
    assert_accepted(gym.make(name, objects="gelatin_box", disable_env_checker=True, **few(name)))


def test_registrations_know_how_long_disturbances_take():
    for name in IDS:
        env = gym.make(name, objects="sugar_box", disable_env_checker=True)
        if env.unwrapped.settings.hold > 1:
            continue  # whose limit is in decisions
        own = {"ClutterHeap-v1": 1800, "ClutterSparse-v1": 600, "ClutterDense-v1": 600, "Clear-v0": 3200}.get(
            name.removeprefix("DexGrasp/"), 300
        )
        assert env.unwrapped.settings.usual_steps == own
        assert gym.spec(name).max_episode_steps == own + env.unwrapped.disturbance_steps
        gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))


@pytest.mark.parametrize(("name", "frame_skip", "settings", "wanted"), table("limits"))
def test_a_limit_that_pace_or_disturbance_makes_too_short_is_warned_of(name, frame_skip, settings, wanted):
    settings = {"objects": "sugar_box", "frame_skip": frame_skip, **settings}
    with pytest.warns(UserWarning, match=f"max_episode_steps={wanted}$"):
        gym.make_vec(f"DexGrasp/{name}", num_envs=1, **settings).close()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        gym.make_vec(f"DexGrasp/{name}", num_envs=1, max_episode_steps=wanted, **settings).close()


def test_a_limit_that_a_wrapper_keeps_is_warned_of_where_it_has_ended_an_episode():
    kwargs = {"objects": "sugar_box", "disturbance": "pushed"}
    env = gym.make("DexGrasp/Lift-v2", disable_env_checker=True, **kwargs)
    env.reset(seed=0)
    while not env.step(np.zeros(23))[3]:
        pass
    with pytest.warns(UserWarning, match="max_episode_steps=380"):
        env.reset()


def test_renders():
    if choose_gl() is None:
        pytest.skip("no GL library here")
    env = make(render_mode="depth_array", render_size=(120, 160))
    env.reset(seed=0)
    depth = env.render()
    assert (depth.shape, depth.dtype) == ((120, 160), np.float32)
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
    assert_equal(first, rollout(other, 3, steps))
    assert_equal(first, rollout(env, 3, steps))
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
    assert_equal(fresh, rollout(env, 7))


@pytest.mark.parametrize("control_mode", [mode for mode in CONTROL_MODES if not mode.endswith("once")])
def test_set_points_keep_range_and_velocity(control_mode):
    env = make(control_mode=control_mode).unwrapped
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    before = HOME.copy()
    for _ in range(40):
        env.step(rng.choice([-1.0, 1.0], env.action_space.shape))
        after = env.targets
        assert np.all(np.abs(after - before) <= max_step(ROBOT) + 1e-12)
        assert np.all((after >= LOWER) & (after <= UPPER))
        before = after


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
    for obs_mode in OBS_SUMS:
        skip_without_gl(obs_mode.removeprefix("state+"))
        env = make(obs_mode=obs_mode)
        listed = {
            row[0].strip("`"): (row[1], row[2])
            for row in rows
            if len(row) == 4 or any(f"`{mode}`" in row[3] for mode in obs_mode.split("+"))
        }
        actual = {key: (str(space.shape), str(space.dtype)) for key, space in env.observation_space.items()}
        assert listed == actual
        assert list(env.reset(seed=0)[0]) == list(actual)  # one order of keys everywhere
        env.close()


def test_page_lists_actions():
    rows = [row for row in table("Action Space") if row[0].startswith("`")]
    sizes = {mode: action_size(mode, default_cell().robot) for mode in CONTROL_MODES}
    assert {row[0].strip("`"): int(row[1]) for row in rows} == sizes
    for mode, size in sizes.items():
        assert make(control_mode=mode).action_space.shape == (size,)


def test_page_lists_rewards_and_arguments():
    rows = [row for row in table("Rewards") if row[0].startswith("`")]
    assert {row[0].strip("`"): float(row[1]) for row in rows} == WEIGHTS
    rows = [row for row in table("Arguments") if row[0].startswith("`")]
    arguments = {row[0].strip("`"): ast.literal_eval(row[1].strip("`")) for row in rows}
    assert arguments.keys() - {"robot", "mount"} == {f.name for f in fields(LiftSettings)} - {"cell"}
    assert LiftSettings.of(**arguments) == LiftSettings.of()


@pytest.mark.parametrize(("kwargs", "word"), mistakes("environments"))
def test_wrong_arguments_are_named_in_one_line(kwargs, word):
    with refused() as caught:
        LiftEnv(**{"objects": "sugar_box", **kwargs})
    assert word in str(caught.value)


def test_wrong_actions_and_options():
    env = make().unwrapped
    with refused("reset"):
        env.step(np.zeros(23))
    env.reset(seed=np.int64(0))
    for action, word in ((np.zeros(22), "shape"), (np.full(23, np.nan), "NaN"), (["1"] * 23, "numbers")):
        with refused(word):
            env.step(action)
    for wrong, words in mistakes("single_resets"):
        with refused(words):
            env.reset(**wrong)
    with refused("a list of names"):
        LiftEnv(objects={"pear"})  # another order in another process
    env.reset(seed=0)
    with refused("beside state"):
        env.reset(options={"state": env.get_state(), "object": "sugar_box"})


@pytest.mark.parametrize(("position", "word"), mistakes("poses"))
def test_impossible_poses_are_refused(position, word):
    env = make().unwrapped
    if word == "in the way":
        env.reset(seed=0)
        position = env.data.site("palm").xpos.copy()
    with refused(word):
        env.reset(options={"object_pose": [*position, 1, 0, 0, 0]})
    with refused("reset"):
        env.step(np.zeros(23))


@pytest.mark.parametrize("name", mistakes("withdrawn"))
def test_withdrawn_ids_say_what_follows_them(name):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(gym.error.DeprecatedEnv, match=name.split("-")[0] + "-v2"):
            gym.make(f"DexGrasp/{name}")
