"""What is computed beside mujoco_warp's physics, on its processor device, beside what numba and rays of MuJoCo say."""

import gymnasium as gym
import numpy as np
import pytest
from numpy.testing import assert_allclose
from refusals import refused
from warp_envs import DEVICE, ID, N, make, throw

from dexgrasp_env.sensing.raycast import RayCameras
from dexgrasp_env.tasks import kernel
from dexgrasp_env.tasks.records import EPISODE
from dexgrasp_env.tasks.rules import PALM, PALM_QUAT, TOUCHING_ANY, TOUCHING_HAND
from dexgrasp_env.tasks.set_points import set_points

pytestmark = pytest.mark.warp

SKIP = 5  # physics steps of a control step: fewer are captured sooner


def anywhere(records, hold, rng):
    """Write any progress to records; what they are of is as a reset left it."""
    for name in ("held", "grasps"):
        records[name] = rng.choice([0, 10, hold - 1, hold + 3], N)
    records["disturbed"], records["warnings"] = rng.integers(0, 80, N), 0
    for name in ("touched", "lifted", "airborne", "grasped", "success", "solved", "window"):
        records[name] = rng.integers(0, 2, records[name].shape)
    for name in ("slip", "tilt", "shift", "height", "grip_position"):
        records[name] = rng.uniform(0.0, 0.1, records[name].shape)
    records["origin"] = rng.normal(0.0, 0.01, (N, 3))
    records["grip_quat"] = quats(rng)
    records["total"], records["latency"] = rng.uniform(0.0, 100.0, N), rng.integers(0, 30, N)
    records["phase"] = np.where(records["phase"] > 0, rng.integers(1, 4, N), 0)


def quats(rng):
    drawn = rng.normal(size=(N, 4))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


def somewhere(envs, rng):
    """Return positions, velocities and sensors of which some are of a held object, and some are no numbers."""
    robot, at = envs.settings.cell.robot, envs._episodes.rules.at
    qpos, qvel = (
        rng.normal(0.0, 1.0, envs._physics.current.qpos.shape),
        rng.normal(0.0, 1.0, envs._physics.current.qvel.shape),
    )
    qpos[:, robot.dof : robot.dof + 3] = rng.uniform([0.0, -0.7, 0.0], [1.1, 0.7, 0.3], (N, 3))
    qpos[:, robot.dof + 3 :] = quats(rng)
    qpos[0, 0] = np.nan
    sensors = rng.normal(0.0, 1.0, envs._physics.current.sensors.shape)
    sensors[:, at[PALM] : at[PALM] + 3] = qpos[:, robot.dof : robot.dof + 3] + rng.normal(0.0, 0.02, (N, 3))
    sensors[:, at[PALM_QUAT] : at[PALM_QUAT] + 4] = quats(rng)
    sensors[:, at[TOUCHING_HAND]] = rng.integers(0, 3, N)
    sensors[:, at[TOUCHING_ANY]] = sensors[:, at[TOUCHING_HAND]] + (rng.random(N) < 0.2)
    return [values.astype(np.float32).astype(float) for values in (qpos, qvel, sensors)]


@pytest.mark.parametrize(
    ("env_id", "mode", "kind", "rewards"),
    [
        ("DexGrasp/Lift-v2", "joint_position", "pushed", "dense"),
        ("DexGrasp/Lift-v2", "ee_delta", "shaken", "sparse"),
        ("DexGrasp/Lift-v2", "joint_delta", "none", "dense"),
    ],
)
def test_the_device_computes_what_numba_does(env_id, mode, kind, rewards):
    envs = make(
        "warp",
        "ycb6",
        env_id,
        control_mode=mode,
        disturbance=kind,
        reward_mode=rewards,
        frame_skip=SKIP,
        max_episode_steps=None,
    ).unwrapped
    envs.reset(seed=0)
    here, physics, rng = envs._episodes, envs._physics, np.random.default_rng(0)
    there, ended = here.device, set()
    for _ in range(50):
        there.fetch()
        anywhere(here.records, here.rules.hold, rng)
        for i in range(N):
            there.load(i)
        there.send()
        records, commands = here.records.copy(), here.commands.copy()
        actions = rng.uniform(-1.5, 1.5, envs.action_space.shape).astype(np.float32)
        rows, push = np.zeros((N, SKIP, commands.shape[2])), np.zeros((N, 3))
        assert set_points(records, commands, actions.astype(float), here.control, rows, push)
        there.set_points(actions)
        assert_allclose(physics.rows.numpy(), rows, atol=2e-6)
        assert_allclose(physics.push.numpy(), push, rtol=1e-5)
        qpos, qvel, sensors = somewhere(envs, rng)
        noise, warnings = (
            rng.normal(0.0, 0.01, (N, commands.shape[2])),
            np.where(rng.random(N) < 0.1, rng.integers(0, 128, N), 0),
        )
        for name, values in (("qpos", qpos), ("qvel", qvel), ("sensordata", sensors)):
            getattr(physics.data, name).assign(values)
        physics.warnings.assign(warnings)
        out = np.zeros_like(here.info_columns), np.zeros(N), np.zeros((N, here.width), np.float32)
        kernel.conclude(records, (qpos, qvel, sensors, commands), warnings, noise, here.rules, out, True)
        seen = there.conclude(noise)
        for ours, theirs in zip((here.info_columns, here.rewards, seen), out, strict=True):
            assert_allclose(ours, theirs, rtol=1e-4, atol=2e-5)
        there.fetch()
        for name in EPISODE.names:
            assert_allclose(here.records[name], records[name], rtol=1e-4, atol=2e-5, err_msg=name)
        ended |= {*here.records["stage"].tolist(), *(-here.records["failure"]).tolist()}
    assert ended == {-2, -1, 0, 1, 2, 3, 4}


def test_goals_and_noisy_joints_are_those_of_numba():
    """Without a collision nothing but rounding is between the two."""
    kwargs = {"max_episode_steps": 4, "frame_skip": SKIP, "randomisation": {"joint_noise": (0.01, 0.01)}}
    ours, theirs = pair = [
        make(name, "sugar_box", "DexGrasp/Place-v2", **kwargs) for name in ("warp", "mujoco")
    ]
    rng = np.random.default_rng(0)
    for envs in pair:
        envs.reset(seed=3)
    for _ in range(7):
        actions = rng.uniform(-1, 1, ours.action_space.shape).astype(np.float32)
        a, b = ours.step(actions), theirs.step(actions)
        for key, values in b[0].items():
            assert_allclose(a[0][key], values, atol=1e-4)
        assert np.array_equal(a[1], b[1])
        assert_allclose(a[4]["goal_distance"], b[4]["goal_distance"], atol=1e-6)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_tensors_hold_what_arrays_do(mode):
    import torch

    kwargs = {"max_episode_steps": 4, "autoreset_mode": mode, "frame_skip": SKIP}
    ours, theirs = (make("warp", "sugar_box", tensors=tensors, **kwargs) for tensors in (True, False))
    (a, _), (b, _) = (envs.reset(seed=1) for envs in (ours, theirs))
    first, rng, ended = {key: values.clone() for key, values in a.items()}, np.random.default_rng(0), 0
    for _ in range(6):
        assert all(np.array_equal(values.cpu(), b[key]) for key, values in a.items())
        actions = rng.uniform(-1, 1, ours.action_space.shape).astype(np.float32)
        now, *told, infos = ours.step(torch.as_tensor(actions, device=a["object_pose"].device))
        b, *theirs_told, theirs_infos = theirs.step(actions)
        assert all(now[key].data_ptr() == values.data_ptr() for key, values in a.items())
        assert [part.dtype for part in told] == [torch.float32, torch.bool, torch.bool]
        assert all(np.array_equal(part.cpu(), other) for part, other in zip(told, theirs_told, strict=True))
        assert np.array_equal(infos["object_height"], theirs_infos["object_height"])
        for last, other in zip(infos.get("final_obs", ()), theirs_infos.get("final_obs", ()), strict=True):
            assert all(np.array_equal(values.cpu(), other[key]) for key, values in last.items())
            ended += 1
    assert not torch.equal(first["joint_positions"], a["joint_positions"])
    assert ended == (N if mode == "SameStep" else 0)
    with refused("action has shape \\(3,\\)"):
        ours.step(torch.zeros(3))
    with refused("NaN or infinite entries at"):
        ours.step(torch.full(ours.action_space.shape, torch.nan))
    with refused("tensors=True is of DexGrasp/Lift with backend='warp'"):
        gym.make_vec(ID, num_envs=2, objects="sugar_box", tensors=True)


def test_cameras_see_as_in_mujoco():
    from dexgrasp_env.sensing.warp_rays import WarpCameras

    scenes = list(make("mujoco").unwrapped._episodes.simulations.values())
    rng, differ, pixels = np.random.default_rng(0), 0, 0
    for scene in scenes[::4]:
        cameras = scene.cell.make_cameras()
        ours, theirs = WarpCameras(scene.base, cameras, DEVICE), RayCameras(scene.base, cameras)
        for _ in range(4):
            throw(scene, rng)
            a, b = ours.render(scene.data), theirs.render(scene.data)
            rims = (
                np.max([np.abs(b - np.roll(b, k, axis)) for axis in (1, 2) for k in (1, -1)], axis=0) > 1e-3
            )
            differ += np.count_nonzero((np.abs(a - b) > 1e-5) & ~rims)
            pixels += a.size
            assert np.count_nonzero(np.abs(a - b) > 1e-5) < 3e-3 * a.size  # rays past an edge
    assert differ < 1e-4 * pixels


def test_observations_of_cameras_are_those_of_mujoco():
    kwargs = {
        "objects": "sugar_box",
        "obs_mode": "state+pointcloud",
        "observe": "step",
        "frame_skip": SKIP,
        "max_episode_steps": 2,
    }
    pair = [make(name, **kwargs) for name in ("warp", "mujoco")]
    (a, _), (b, _) = (envs.reset(seed=3) for envs in pair)
    for _ in range(4):
        assert a.keys() == b.keys()
        assert all(a[key].dtype == b[key].dtype and a[key].shape == b[key].shape for key in b)
        assert_allclose(a["table_plane"], b["table_plane"], atol=2e-3)
        apart = np.linalg.norm(a["cloud"].mean(axis=1) - b["cloud"].mean(axis=1), axis=1)
        assert np.median(apart) < 1e-3
        actions = np.zeros(pair[0].action_space.shape, np.float32)
        a, b = (envs.step(actions)[0] for envs in pair)
