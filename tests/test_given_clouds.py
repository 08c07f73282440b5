"""Captures that nobody here made, where they lie beside the checkout: each does what is right for it."""

import numpy as np
import pytest
from seen_tables import GIVEN
from tables import table

from dexgrasp.planning.plan_scene import plan_cloud, scene_of
from dexgrasp_env.perception.camera_pose import read_pose
from dexgrasp_env.perception.scan import read_scan
from dexgrasp_env.perception.selection import TargetSelector

ONE = table("clouds_of_one")
pytestmark = pytest.mark.skipif(not GIVEN.is_dir(), reason="the captures are not here")


def points_of(name):
    return read_scan(GIVEN / f"{name}.ply").points


@pytest.mark.parametrize("name", ONE)
@pytest.mark.parametrize("how", ["given", "thinned", "turned"])
def test_one_object_is_one(name, how):
    points = points_of(name)
    rng = np.random.default_rng(5)
    if how == "thinned":
        points = points[rng.random(len(points)) < 0.5]
    if how == "turned":  # about the middle of the workspace
        middle, angle = np.array([0.52, 0.0]), np.radians(25.0)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        points = np.c_[(points[:, :2] - middle) @ turn.T + middle, points[:, 2]]
    scene = scene_of(points, seed={"given": 0, "thinned": 1, "turned": 2}[how])
    assert scene.reason is None, scene.sentence
    assert all(one.points[:, 2].min() > 0.3 for one in scene.neighbours)  # boards above are obstacles


@pytest.mark.slow
@pytest.mark.parametrize("name", ONE)
def test_one_object_is_grasped(name):
    plan = plan_cloud(points_of(name), seed=0)
    assert plan.success, plan.reason


@pytest.mark.parametrize("name", ["stack_can_on_tin", "stack_box_on_box"])
def test_a_stack_is_two(name):
    truth = np.load(GIVEN / f"{name}_mask.npy")
    scene = scene_of(points_of(name))
    assert scene.reason == "several_objects"
    assert len(scene.neighbours) >= len(np.unique(truth[truth > 0]))
    assert any(one.doubt for one in scene.neighbours)


def test_what_is_hidden_in_part_is_doubtful():
    scene = scene_of(points_of("hidden_box_behind"))
    assert scene.reason == "several_objects"
    assert any("hidden in part" in one.doubt for one in scene.neighbours)


def test_what_was_seen_from_above_alone_has_walls_straight_down():
    plan = plan_cloud(points_of("overhead_can_10cm"), seed=0)
    corners = plan.target.corners
    low = corners[corners[:, 2] < 0.02]
    assert np.ptp(low[:, :2], axis=0).min() > 0.05  # a can 66 mm wide


def test_splinters_of_the_object_that_is_meant_do_not_block_it():
    scene = scene_of(points_of("scene_milk_kinect"), TargetSelector(near=np.array([0.42, -0.02, 0.13])))
    assert scene.reason is None
    gaps = [np.linalg.norm(one.points.mean(0) - scene.target.points.mean(0)) for one in scene.neighbours]
    assert min(gaps) > 0.08


def test_three_objects_are_three():
    truth = np.load(GIVEN / "good_three_objects_mask.npy")
    scene = scene_of(points_of("good_three_objects"))
    assert scene.reason == "several_objects"
    assert len(scene.neighbours) == len(np.unique(truth[truth > 0]))


def test_a_cloud_of_the_cameras_frame_stands_on_its_table():
    pose = read_pose(str(GIVEN / "camera_frame_T_base_camera.txt"))
    scene = scene_of(read_scan(GIVEN / "camera_frame.pcd", T_base_camera=pose))
    assert scene.reason in (None, "several_objects")
