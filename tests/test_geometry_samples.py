import pytest
import trimesh
from numpy.testing import assert_allclose

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
