import time

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from agents.geometry.exact import ExactDistance
from agents.geometry.normals import smooth_normals, surface_samples
from dexgrasp_env.errors import InputError


@pytest.fixture(scope="module")
def box():
    return trimesh.creation.box((0.06, 0.08, 0.1))


@pytest.mark.parametrize("n", [1, 2, 256, 2048])
def test_samples_have_the_exact_count_and_lie_on_their_faces(box, n):
    samples = surface_samples(box, n, 0)
    assert samples.points.shape == samples.normals.shape == (n, 3)
    np.testing.assert_allclose(ExactDistance.from_mesh(box).distance(samples.points), 0.0, atol=1e-12)
    np.testing.assert_allclose(samples.normals, box.face_normals[samples.faces], atol=1e-12)
    offset = ((samples.points - box.triangles[samples.faces][:, 0]) * samples.normals).sum(-1)
    np.testing.assert_allclose(offset, 0.0, atol=1e-12)


def test_samples_are_spread_evenly():
    ball = trimesh.creation.icosphere(4, 0.05)
    points = surface_samples(ball, 256, 1).points
    gaps = cKDTree(points).query(points, 2)[0][:, 1]
    packed = 2 * np.sqrt(ball.area / (2 * np.sqrt(3) * 256))
    assert gaps.min() > 0.55 * packed  # uniform random points: about 0.03


def test_samples_are_shared_by_area(box):
    counts = np.bincount(surface_samples(box, 2048, 2).faces, minlength=12)
    np.testing.assert_allclose(counts / 2048, box.area_faces / box.area, atol=0.01)


def test_samples_depend_on_the_seed_only(box):
    first, same, other = (surface_samples(box, 256, seed).points for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, same)
    np.testing.assert_array_equal(first, surface_samples(box, 256, np.random.default_rng(3)).points)
    assert (first != other).any()


def test_256_samples_are_quick(box):
    surface_samples(box, 256, 0)
    times = []
    for seed in range(5):
        start = time.perf_counter()
        surface_samples(box, 256, seed)
        times.append(time.perf_counter() - start)
    assert min(times) < 0.02


def test_smooth_normals_keep_to_their_side_of_a_right_angle(box):
    along = np.array([[0.03, 0.0, z] for z in (0.0, 0.04, 0.045, 0.0499)])
    normals = smooth_normals(box, along, np.tile([1.0, 0.0, 0.0], (4, 1)), 0.008)
    np.testing.assert_allclose(normals[:2], [[1, 0, 0], [1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert normals[3, 2] == pytest.approx(
        0.0, abs=1e-12
    )  # the other face is perpendicular: it does not count


def test_smooth_normals_of_a_ball_are_radial():
    ball = trimesh.creation.icosphere(3, 0.05)
    samples = surface_samples(ball, 256, 0)
    smooth = smooth_normals(ball, samples.points, samples.normals, 0.01)
    radial = samples.points / np.linalg.norm(samples.points, axis=1, keepdims=True)
    error = np.degrees(np.arccos((smooth * radial).sum(-1).clip(-1, 1)))
    faceted = np.degrees(np.arccos((samples.normals * radial).sum(-1).clip(-1, 1)))
    assert error.mean() < 0.6 * faceted.mean()


def test_bad_input_is_refused(box):
    with pytest.raises(InputError, match="at least 1"):
        surface_samples(box, 0, 0)
    with pytest.raises(InputError, match="radius"):
        smooth_normals(box, np.zeros((1, 3)), np.zeros((1, 3)), 0.0)
    with pytest.raises(InputError, match="area"):
        surface_samples(trimesh.Trimesh(np.zeros((3, 3)), [[0, 1, 2]], process=False), 4, 0)
