"""Objects that stand close are told apart, and one that is alone stays whole."""

import numpy as np
import pytest
from test_scene_cloud import box

from dexgrasp_env.objects.load import load_target
from dexgrasp_env.perception.instances import segment_instances
from dexgrasp_env.perception.plane import Plane
from dexgrasp_env.perception.scan import cloud_of
from dexgrasp_env.poses import about_z

TABLE = Plane(np.array([0.0, 0.0, 1.0]), 0.0, 0.0008)


def above(*things):
    cloud = cloud_of(np.concatenate(things))
    return cloud.select(cloud.points[:, 2] > 0.004)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@pytest.mark.parametrize("gap", [0.008, 0.015])
def test_boxes_that_stand_close_are_two(rng, gap):
    high = np.array([0.06, 0.08, 0.09])
    cloud = above(box(rng, (0.5, 0.0), high), box(rng, (0.56 + gap, 0.0)))
    labels = segment_instances(cloud, TABLE).labels
    left = cloud.points[:, 0] < 0.53 + 0.5 * gap
    assert len(np.unique(labels)) == 2
    for side in (left, ~left):
        assert (labels[side] == labels[side][0]).mean() > 0.95


@pytest.mark.parametrize("seed", range(4))
def test_points_that_fly_in_a_gap_join_nothing(seed):
    """With seed 2 two links of a thousand points joined a box and another, whose edge is next to its side."""
    rng, cube = np.random.default_rng(seed), np.array([0.06, 0.06, 0.09])
    one, other = box(rng, (0.5, 0.0), cube), box(rng, (0.0, 0.0), cube)
    other = other @ about_z(np.pi / 4)[:3, :3].T + [0.543 + 0.03 * np.sqrt(2.0), 0.0, 0.0]
    assert len(np.unique(segment_instances(above(one, other), TABLE).labels)) == 2


@pytest.mark.parametrize("name", ["sugar_box", "massage_ball", "castle", "hairspray_bottle"])
def test_one_that_is_alone_is_one(rng, name):
    mesh = load_target(name).mesh
    points = mesh.sample(4000, seed=1) + rng.normal(0.0, 0.0005, (4000, 3))
    instances = segment_instances(above(points - [0.0, 0.0, points[:, 2].min()]), TABLE)
    assert len(np.unique(instances.labels)) == 1
