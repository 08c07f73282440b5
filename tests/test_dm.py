"""dm_control's environment against the Gymnasium environment whose physics it advances."""

import gymnasium as gym
import numpy as np
import pytest
from refusals import refused

# First of all: dm_control settles on a GL library when it is imported.
pytest.importorskip("dexgrasp_env.dm", exc_type=ImportError)

import dm_env
from dm_control.rl import control
from dm_control.suite.wrappers import pixels

from dexgrasp_env import dm
from dexgrasp_env.rendering import rendering_fault

SIZES = {"size": (0.9, 1.1), "latency": (0.0, 0.04), "joint_noise": (0.0, 0.01)}


@pytest.mark.parametrize("obs_mode", ["state", "pointcloud"])
def test_specs_hold(obs_mode):
    env = dm.load("sugar_box", seed=0, obs_mode=obs_mode)
    specs, action_spec = env.observation_spec(), env.action_spec()
    rng = np.random.default_rng(0)
    timestep = env.reset()
    assert isinstance(env, control.Environment)
    assert env.control_timestep() == 0.05
    assert timestep.first()
    assert timestep.reward is None
    for _ in range(3):
        assert set(specs) == set(timestep.observation)
        for key, spec in specs.items():
            spec.validate(timestep.observation[key])
        action = rng.uniform(-1, 1, action_spec.shape).astype(action_spec.dtype)
        action_spec.validate(action)
        timestep = env.step(action)
        env.reward_spec().validate(timestep.reward)
        env.discount_spec().validate(timestep.discount)
        assert timestep.mid()
        assert timestep.discount == 1.0


@pytest.mark.parametrize(
    ("env_id", "kwargs"),
    [
        ("DexGrasp/Lift-v2", {"control_mode": "ee_delta", "randomisation": SIZES}),
        ("DexGrasp/LiftPushed-v2", {"reward_mode": "sparse"}),
        ("DexGrasp/LiftOneView-v2", {"calibration": {"position": 0.01}}),
        ("DexGrasp/Place-v2", {"reward_mode": "dense"}),
    ],
)
def test_same_rollout_as_gymnasium(env_id, kwargs):
    """Every number of four episodes, over objects of different models, in every bit."""
    settings = {"objects": ["sugar_box", "soda", "massage_ball"], "max_episode_steps": 6, **kwargs}
    env = dm.load(env_id=env_id, seed=3, **settings)
    other = gym.make(env_id, disable_env_checker=True, **settings)
    rng = np.random.default_rng(0)
    objects, action = set(), np.zeros(env.action_spec().shape)
    for episode in range(4):
        # The first by a reset, the others by the step after a last one.
        timestep = env.reset() if episode == 0 else env.step(action)
        assert timestep.first()
        observation, info = other.reset(seed=3 if episode == 0 else None)
        objects.add(info["object"])
        while True:
            assert set(timestep.observation) == set(observation)
            for key in observation:
                np.testing.assert_array_equal(timestep.observation[key], observation[key])
            assert np.array_equal(env.physics.data.qpos, other.unwrapped.data.qpos)
            assert env.task.info["reward_terms"] == info["reward_terms"]
            if timestep.last():
                break
            action = rng.uniform(-1, 1, env.action_spec().shape)
            timestep = env.step(action)
            observation, reward, terminated, truncated, info = other.step(action)
            assert timestep.reward == reward
            assert timestep.last() == (terminated or truncated)
    assert len(objects) > 1


def test_termination_ends_the_discount_and_the_time_limit_does_not():
    env = dm.load("sugar_box", seed=0, max_episode_steps=3)
    env.reset()
    steps = [env.step(np.zeros(23)) for _ in range(3)]
    assert [step.step_type for step in steps] == [dm_env.StepType.MID] * 2 + [dm_env.StepType.LAST]
    assert steps[-1].discount == 1.0
    env.reset()
    env.physics.data.qvel[25] = 1e12
    timestep = env.step(np.zeros(23))
    assert timestep.last()
    assert timestep.discount == 0.0
    assert env.task.info["failure"] == "simulation_diverged"


def test_physics_is_the_environments_own():
    env = dm.load("sugar_box", seed=0)
    assert env.step(np.zeros(23)).first()  # no reset before
    physics, inner = env.physics, env.task.inner
    assert physics.data.ptr is inner.data
    assert physics.model.ptr is inner.model
    physics.named.data.xfrc_applied["object", 2] = 100.0  # as the viewer's mouse does
    env.step(np.zeros(23))
    assert physics.named.data.qvel["object"][2] > 1.0
    time = physics.time()
    physics.step(2)  # without a task: physics steps
    assert physics.time() == pytest.approx(time + 0.004)
    physics.copy().step()
    assert physics.time() == pytest.approx(time + 0.004)


@pytest.mark.skipif(rendering_fault() is not None, reason="no GL here")
def test_pixels():
    size = dict(height=60, width=80, camera_id="front_left")
    env = pixels.Wrapper(dm.load("sugar_box", seed=0), pixels_only=False, render_kwargs=size)
    first = env.reset().observation["pixels"]
    for _ in range(5):
        last = env.step(np.ones(23)).observation["pixels"]
    assert first.shape == (60, 80, 3)
    assert env.observation_spec()["pixels"].shape == first.shape
    assert not np.array_equal(first, last)
    env.physics.free()


def test_wrong_arguments():
    with refused("obs_mode"):
        dm.load("sugar_box", obs_mode="pixels")
    with refused("LiftUpright-v2"):
        dm.load(env_id="DexGrasp/Lift-v7")
    with refused("an action a control step"):
        dm.load("sugar_box", env_id="DexGrasp/LiftOnce-v0")
