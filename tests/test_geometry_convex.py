import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from oracles import box_distance
from refusals import refused

from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.geometry.convex_kernel import convex_distance_hessian

SIDES = np.array([0.06, 0.16, 0.21])


@pytest.fixture(scope="module")
def box():
    return ConvexDistance.from_points(trimesh.creation.box(SIDES).vertices)


@pytest.fixture(scope="module")
def can():
    return ConvexDistance.from_points(trimesh.creation.cylinder(0.033, 0.1, sections=64).vertices)


def scatter(rng, n, size=0.3):
    return rng.uniform(-size, size, (n, 3))


def test_box_is_exact_inside_and_outside(box):
    points = scatter(np.random.default_rng(0), 5000)
    assert_allclose(box.distance(points), box_distance(points, SIDES), atol=1e-15)
    assert (box.distance(points) < 0).any()


def test_far_and_near_points_of_many_faces_agree_with_every_triangle(can):
    points = scatter(np.random.default_rng(1), 300)
    mesh = trimesh.Trimesh(can.triangles.reshape(-1, 3), np.arange(3 * len(can.triangles)).reshape(-1, 3))
    corners = np.repeat(can.triangles[None], len(points), 0).reshape(-1, 3, 3)
    queries = np.repeat(points, len(can.triangles), 0)
    nearest = trimesh.triangles.closest_point(corners, queries)
    expected = np.linalg.norm(nearest - queries, axis=1).reshape(len(points), -1).min(axis=1)
    assert mesh.is_watertight
    assert_allclose(np.abs(can.distance(points)), expected, atol=1e-12)


@pytest.mark.parametrize("name", ["box", "can"])
def test_gradient_and_hessian_agree_with_finite_differences(name, request):
    shape = request.getfixturevalue(name)
    step = 1e-6 * np.eye(3)
    agree = []
    for p in scatter(np.random.default_rng(2), 400):
        g, H = np.empty(3), np.empty((3, 3))
        d = convex_distance_hessian(p, shape.obstacle, g, H)
        if d < 1e-3:
            continue
        ahead, behind = shape.distance_gradient(p + step), shape.distance_gradient(p - step)
        assert_allclose((ahead[0] - behind[0]) / 2e-6, g, atol=1e-4)
        agree.append(np.abs((ahead[1] - behind[1]) / 2e-6 - H).max() * d < 1e-6)
    assert np.mean(agree) > 0.99  # a point within the step of a feature's border has two Hessians


@pytest.fixture(scope="module")
def hammer():
    """A handle along x and a head across its end."""
    handle, head = trimesh.creation.box((0.2, 0.03, 0.03)), trimesh.creation.box((0.03, 0.1, 0.03))
    head.apply_translation([0.1, 0.0, 0.0])
    return [ConvexDistance.from_points(handle.vertices), ConvexDistance.from_points(head.vertices)]


def test_distance_to_a_union_is_the_least_of_its_parts(hammer):
    union, points = ConvexDistance.union(hammer), scatter(np.random.default_rng(8), 3000, 0.2)
    each = [part.distance_gradient(points) for part in hammer]
    nearest = np.argmin([d for d, _ in each], axis=0)
    assert set(nearest) == {0, 1}
    distances, gradients = union.distance_gradient(points)
    for k, (d, g) in enumerate(each):  # to the bit: a part among others is computed as it is alone
        assert_array_equal(distances[nearest == k], d[nearest == k])
        assert_array_equal(gradients[nearest == k], g[nearest == k])
    closest, outside = points - distances[:, None] * gradients, distances > 0
    assert_allclose(union.distance(closest)[outside], 0.0, atol=1e-12)
    assert union.distance([[0.05, 0.03, 0.0]])[0] == pytest.approx(0.015)  # in the hull's air


@pytest.mark.parametrize("points", [np.eye(3), np.zeros((10, 3)), np.full((8, 3), np.nan), np.zeros((8, 2))])
def test_points_without_a_volume_are_refused(points):
    with refused("convex hull"):
        ConvexDistance.from_points(points)
