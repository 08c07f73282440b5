"""Distances to meshes against analytic solids."""

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from oracles import box_distance
from tables import table

from dexgrasp.geometry.mesh_distance import closest_on_mesh
from dexgrasp.geometry.surface_samples import triangle_samples

SIDES = np.array([0.06, 0.08, 0.1])


def torus_distance(points):
    return np.hypot(np.hypot(points[:, 0], points[:, 1]) - 0.04, points[:, 2]) - 0.015


@pytest.fixture(scope="module")
def torus():
    return trimesh.creation.torus(0.04, 0.015, major_sections=128, minor_sections=64)


@pytest.fixture(scope="module")
def box():
    return trimesh.creation.box(SIDES).subdivide().subdivide()


@pytest.fixture(scope="module")
def points():
    return np.random.default_rng(0).uniform(-0.07, 0.07, (1000, 3))


def test_exact_box_inside_outside_and_beside_sharp_edges(box, points):
    corners = SIDES / 2 * np.array(table("places_on_a_box"))
    near = (corners[:, None] + 1e-4 * np.random.default_rng(1).normal(size=(3, 200, 3))).reshape(-1, 3)
    for queries in (points, near):
        assert_allclose(closest_on_mesh(box, queries).distances, box_distance(queries, SIDES), atol=1e-15)


def test_exact_torus_to_the_facets(torus, points):
    error = closest_on_mesh(torus, points).distances - torus_distance(points)
    assert np.abs(error).max() < 5e-5


@pytest.mark.parametrize("shape", ["box", "torus"])
def test_exact_closest_point_and_gradient(shape, points, request):
    mesh, some = request.getfixturevalue(shape), points[:300]
    distances, closest, gradients = closest_on_mesh(mesh, some)
    assert_allclose(closest + distances[:, None] * gradients, some, atol=1e-15)
    assert_allclose(np.linalg.norm(gradients, axis=1), 1.0, atol=1e-12)
    assert np.abs(closest_on_mesh(mesh, closest).distances).max() < 1e-12


def test_exact_sign_at_a_knife_edge():
    """Where the nearest feature is an edge or vertex, either face's own normal would give a wrong sign."""
    wedge = trimesh.convex.convex_hull(table("wedge"))
    rng = np.random.default_rng(2)
    before = np.c_[
        rng.uniform(-0.02, -1e-4, 500), rng.uniform(-0.07, 0.07, 500), rng.uniform(-0.02, 0.02, 500)
    ]
    assert (closest_on_mesh(wedge, before).distances > 0).all()


@pytest.mark.parametrize("n", [1, 2, 256, 2048])
def test_samples_have_the_exact_count_and_lie_on_their_faces(box, n):
    samples = triangle_samples(box.triangles, n, 0)
    assert samples.points.shape == samples.normals.shape == (n, 3)
    distances, _, gradients = closest_on_mesh(box, samples.points + 1e-3 * samples.normals)
    assert_allclose(distances, 1e-3, atol=1e-12)
    assert_allclose(samples.normals, gradients, atol=1e-9)
