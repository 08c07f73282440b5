"""Rest poses of shapes whose answer is known."""

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from dexgrasp_env.objects.catalogue import CATALOGUE
from dexgrasp_env.objects.load import load_object
from dexgrasp_env.objects.model import ObjectModel, centred_model
from dexgrasp_env.objects.rest_poses import (
    MOST_POSES,
    drop_model,
    find_rest_poses,
    rest_poses,
)
from dexgrasp_env.objects.shapes import Shape, box
from dexgrasp_env.poses import quat_to_matrix

pytestmark = pytest.mark.usefixtures("own_cache")


def model_of(shape: Shape, name: str = "thing") -> ObjectModel:
    return centred_model(name, shape.mesh, shape.parts, 0.2)


def test_a_box_rests_on_each_face_and_most_often_on_the_largest():
    poses = find_rest_poses(model_of(box((0.06, 0.08, 0.10))))
    heights = np.array([pose.height for pose in poses])
    assert_allclose(heights, [0.03, 0.03, 0.04, 0.04, 0.05, 0.05], atol=1e-6)
    shares = np.array([pose.probability for pose in poses]).reshape(3, 2)
    assert shares.sum() == pytest.approx(1, abs=1e-4)
    assert np.all(np.diff(shares.mean(1)) < 0)
    assert np.ptp(shares, axis=1).max() < 0.05
    assert_allclose(np.abs([pose.up for pose in poses]).max(1), 1, atol=1e-8)


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_shipped_poses_are_up_to_date_and_stable(name, tmp_path):
    model = load_object(name)
    poses = rest_poses.__wrapped__(model)
    assert not list(tmp_path.rglob("*.json")), "computed anew: run scripts/make_rest_poses.py"
    assert 1 <= len(poses) <= MOST_POSES
    assert sum(pose.probability for pose in poses) == pytest.approx(1, abs=1e-4)
    mj_model = drop_model(model)
    for pose in poses:
        data = mujoco.MjData(mj_model)
        data.qpos[2:7] = [pose.height, *pose.quat_wxyz]
        mujoco.mj_step(mj_model, data, 250)
        assert quat_to_matrix(data.qpos[3:7])[2] @ pose.up > np.cos(0.05)
        assert abs(data.qpos[2] - pose.height) < 1e-3
