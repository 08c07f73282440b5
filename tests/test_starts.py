"""Beginnings near success: the robot's joints at a reset, certified pre-grasps, and how they move back."""

import gymnasium as gym
import numpy as np
import pytest
from lift_envs import make
from numpy.testing import assert_allclose
from refusals import refused
from robots import HOME, UPPER

from dexgrasp_env.assets import asset_path
from dexgrasp_env.tasks.starts import PreGrasps

ID = "DexGrasp/LiftFromGrasp-v0"
POSE = [0.5, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0]


def test_the_robot_begins_at_joints_that_are_given():
    env, joints = make(), np.minimum(HOME + 0.05, UPPER)
    seen, _ = env.reset(seed=0, options={"object_pose": POSE, "joints": joints})
    assert_allclose(seen["joint_targets"], joints, atol=1e-6)
    assert_allclose(seen["joint_positions"], joints, atol=0.02)
    after, *_ = env.step(np.zeros(23))
    assert_allclose(after["joint_positions"], seen["joint_positions"], atol=0.01)
    usual, _ = env.reset(seed=0)
    assert_allclose(usual["joint_targets"], HOME, atol=1e-6)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"joints": HOME}, "give object_pose beside it"),
        ({"joints": HOME[:7], "object_pose": POSE}, r"shape \(23\)"),
        ({"joints": UPPER + 0.1, "object_pose": POSE}, "panda_joint1"),
    ],
)
def test_joints_that_cannot_be_are_refused(options, word):
    with refused(word):
        make().reset(options=options)


def test_episodes_begin_on_the_way_to_pre_grasps():
    objects = ["sugar_box", "mustard_bottle"]
    starts = PreGrasps(objects=objects)
    assert starts.ways >= 4
    assert [*dict.fromkeys(starts.names)] == objects
    env = gym.make(ID, objects=objects, obs_mode="state")
    for way in range(starts.ways):
        for share, near in ((0.0, False), (1.0, True)):
            seen, info = env.reset(seed=way, options=starts.options(way, share))
            gaps = np.linalg.norm(seen["fingertip_positions"].reshape(4, 3) - seen["object_pose"][:3], axis=1)
            assert (gaps.min() < 0.12) == near
            assert info["stage"] == "untouched"
            moved = np.abs(seen["object_pose"][:3] - starts.poses[way, :3]).max()
            assert moved < 0.005  # nothing was pushed by the hand that is there already


def test_starts_move_back_as_episodes_succeed():
    starts, rng = PreGrasps(objects=["sugar_box"], whole=0.0), np.random.default_rng(0)
    for solved, front in ((False, 0.9), (True, 0.7)):
        for _ in range(250):
            starts(0, rng, {"solved": solved})
        assert starts.front <= front
    assert starts.front == pytest.approx(0.9 - 0.1 * round((0.9 - starts.front) / 0.1))
    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box")
    assert "level" not in env.reset(seed=0)[1]
    with refused("valid is what returns"):
        env.unwrapped.start_from(PreGrasps)
    env.unwrapped.start_from(starts)
    assert env.reset(seed=0)[1]["level"] == starts.front


def test_files_that_are_none_are_refused(tmp_path):
    with refused("does not exist"):
        gym.make(ID, starts=str(tmp_path / "none.npz"))
    whole = asset_path("pregrasps.npz").read_bytes()
    for content in (b"no arrays", whole[:3000]):
        (tmp_path / "other.npz").write_bytes(content)
        with refused("holds no pre-grasps"):
            gym.make(ID, starts=str(tmp_path / "other.npz"))
    with refused("valid is that one"):
        gym.make(ID, mount="fingers_along")
    with refused("of none of these objects: valid are .*sugar_box"):
        gym.make(ID, objects="varied-3")
