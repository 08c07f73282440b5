"""Exact and gridded distances to meshes against analytic solids."""

import numpy as np
import pytest
import trimesh

from dexgrasp.geometry.exact import closest_on_mesh
from dexgrasp.geometry.grid import GridDistance
from dexgrasp_env.errors import InputError

SIDES = np.array([0.06, 0.08, 0.1])


def box_distance(points):
    q = np.abs(points) - SIDES / 2
    return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)


def torus_distance(points):
    return np.hypot(np.hypot(points[:, 0], points[:, 1]) - 0.04, points[:, 2]) - 0.015


@pytest.fixture(scope="module")
def torus():
    return trimesh.creation.torus(0.04, 0.015, major_sections=128, minor_sections=64)


@pytest.fixture(scope="module")
def box():
    return trimesh.creation.box(SIDES).subdivide().subdivide()


@pytest.fixture(scope="module")
def torus_grid(torus):
    return GridDistance.from_mesh(torus)


@pytest.fixture(scope="module")
def points():
    return np.random.default_rng(0).uniform(-0.07, 0.07, (1000, 3))


def test_exact_box_inside_outside_and_beside_sharp_edges(box, points):
    corners = SIDES / 2 * np.array([[1, 1, 1], [1, 1, 0.3], [-1, 0.2, 1]])
    near = (corners[:, None] + 1e-4 * np.random.default_rng(1).normal(size=(3, 200, 3))).reshape(-1, 3)
    for queries in (points, near):
        np.testing.assert_allclose(closest_on_mesh(box, queries).distances, box_distance(queries), atol=1e-15)


def test_exact_torus_to_the_facets(torus, points):
    error = closest_on_mesh(torus, points).distances - torus_distance(points)
    assert np.abs(error).max() < 5e-5


@pytest.mark.parametrize("shape", ["box", "torus"])
def test_exact_closest_point_and_gradient(shape, points, request):
    mesh, some = request.getfixturevalue(shape), points[:300]
    distances, closest, gradients = closest_on_mesh(mesh, some)
    np.testing.assert_allclose(closest + distances[:, None] * gradients, some, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(gradients, axis=1), 1.0, atol=1e-12)
    assert np.abs(closest_on_mesh(mesh, closest).distances).max() < 1e-12


def test_on_the_surface_the_gradient_is_the_normal(box):
    top = np.array([[0.011, 0.007, SIDES[2] / 2]])
    np.testing.assert_allclose(closest_on_mesh(box, top).gradients, [[0, 0, 1]], atol=1e-12)


def test_exact_agrees_with_trying_every_triangle(torus, points):
    some = points[:20]
    queries = np.repeat(some, len(torus.faces), 0)
    nearest = trimesh.triangles.closest_point(np.tile(torus.triangles, (20, 1, 1)), queries)
    expected = np.linalg.norm(nearest - queries, axis=1).reshape(20, -1).min(axis=1)
    np.testing.assert_allclose(np.abs(closest_on_mesh(torus, some).distances), expected, atol=1e-15)


def test_exact_sign_at_a_knife_edge():
    """Where the nearest feature is an edge or vertex, either face's own normal would give a wrong sign."""
    wedge = trimesh.convex.convex_hull([[0, -0.05, 0], [0, 0.05, 0], [0.1, -0.05, 0.002], [0.1, 0.05, 0.002],
                                        [0.1, -0.05, -0.002], [0.1, 0.05, -0.002]])  # fmt: skip
    rng = np.random.default_rng(2)
    before = np.c_[
        rng.uniform(-0.02, -1e-4, 500), rng.uniform(-0.07, 0.07, 500), rng.uniform(-0.02, 0.02, 500)
    ]
    assert (closest_on_mesh(wedge, before).distances > 0).all()


def test_unwelded_vertices_do_not_matter(box, points):
    loose = trimesh.Trimesh(
        box.triangles.reshape(-1, 3), np.arange(3 * len(box.faces)).reshape(-1, 3), process=False
    )
    np.testing.assert_array_equal(
        closest_on_mesh(loose, points).distances, closest_on_mesh(box, points).distances
    )


def test_grid_error_on_a_smooth_solid(torus, torus_grid, points):
    error = np.abs(torus_grid.distance(points) - closest_on_mesh(torus, points).distances)
    near = np.abs(torus_distance(points)) < 0.01  # beyond, the distance has creases
    assert error[near].max() < 5e-5
    assert error[near].mean() < 1e-5


def test_grid_error_at_sharp_edges(box, points):
    grid = GridDistance.from_mesh(box)
    near = (box_distance(points) > -0.01) & (np.abs(points) < SIDES / 2 + 0.03).all(axis=1)
    error = np.abs(grid.distance(points) - box_distance(points))[near]
    assert error.max() < 5e-4
    assert np.quantile(error, 0.99) < 4e-4
    assert error.mean() < 3e-5


def test_grid_gradient_is_the_derivative_inside_and_outside_the_grid(torus_grid):
    points = np.random.default_rng(3).uniform(-0.15, 0.15, (2000, 3))
    _, gradients = torus_grid.distance_gradient(points)
    step = 1e-5
    for k in range(3):
        offset = step * np.eye(3)[k]
        slope = (torus_grid.distance(points + offset) - torus_grid.distance(points - offset)) / (2 * step)
        assert np.quantile(np.abs(slope - gradients[:, k]), 0.99) < 2e-3


def test_grid_value_outside_is_at_least_the_distance(torus_grid):
    points = np.random.default_rng(4).uniform(-0.5, 0.5, (2000, 3))
    values, truth = torus_grid.distance(points), torus_distance(points)
    assert (values > truth - 1e-4).all()


def test_builds_are_deterministic(torus, torus_grid):
    np.testing.assert_array_equal(GridDistance.from_mesh(torus).coeffs, torus_grid.coeffs)


def test_open_mesh_has_no_grid(box):
    opened = trimesh.Trimesh(box.vertices, box.faces[1:])
    with pytest.raises(InputError, match="fill its holes"):
        GridDistance.from_mesh(opened)
    assert np.isfinite(closest_on_mesh(opened, np.zeros((1, 3))).distances).all()


def test_inside_out_mesh_has_no_grid(box):
    with pytest.raises(InputError, match="fix_normals"):
        GridDistance.from_mesh(trimesh.Trimesh(box.vertices, box.faces[:, ::-1], process=False))


@pytest.mark.parametrize(
    "settings", [{"spacing": 0.0}, {"spacing": np.nan}, {"margin": -1.0}, {"spacing": 1e-5}]
)
def test_settings_out_of_range(box, settings):
    with pytest.raises(InputError, match="valid are"):
        GridDistance.from_mesh(box, **settings)


def test_empty_mesh_is_refused():
    with pytest.raises(InputError, match="valid are"):
        closest_on_mesh(trimesh.Trimesh(), np.zeros((1, 3)))
