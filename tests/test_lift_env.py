"""Lift-v2 against its contract: checkers, determinism, resets, control, endings."""

import warnings

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from lift_envs import assert_same, few, make, rollout, skip_without_gl
from robots import HOME, LOWER, ROBOT, UPPER
from tables import table

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp_env.rendering import choose_gl
from dexgrasp_env.tasks.control import CONTROL_MODES, max_step
from dexgrasp_env.tasks.observations import OBS_MODES

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
    assert_same(rollout(env, 3, 6), rollout(other, 3, 6))
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
