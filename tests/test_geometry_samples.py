import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree

from dexgrasp.geometry.mesh_distance import closest_on_mesh
from dexgrasp.geometry.surface_samples import triangle_samples


@pytest.fixture(scope="module")
def box():
    return trimesh.creation.box((0.06, 0.08, 0.1))


@pytest.mark.parametrize("n", [1, 2, 256, 2048])
def test_samples_have_the_exact_count_and_lie_on_their_faces(box, n):
    samples = triangle_samples(box.triangles, n, 0)
    assert samples.points.shape == samples.normals.shape == (n, 3)
    distances, _, gradients = closest_on_mesh(box, samples.points + 1e-3 * samples.normals)
    assert_allclose(distances, 1e-3, atol=1e-12)
    assert_allclose(samples.normals, gradients, atol=1e-9)


def test_samples_are_spread_evenly():
    ball = trimesh.creation.icosphere(4, 0.05)
    points = triangle_samples(ball.triangles, 256, 1).points
    gaps = cKDTree(points).query(points, 2)[0][:, 1]
    packed = 2 * np.sqrt(ball.area / (2 * np.sqrt(3) * 256))
    assert gaps.min() > 0.55 * packed  # uniform random points: about 0.03


def test_samples_depend_on_the_seed_only(box):
    first, same, other = (triangle_samples(box.triangles, 256, seed).points for seed in (3, 3, 4))
    assert_array_equal(first, same)
    assert_array_equal(first, triangle_samples(box.triangles, 256, np.random.default_rng(3)).points)
    assert (first != other).any()
