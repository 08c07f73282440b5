"""Each step of the pipeline on inputs with a known answer."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from robots import CELL, HOME
from scipy.spatial import ConvexHull

from dexgrasp.geometry.hull import cloud_corners
from dexgrasp_env.perception.cloud import (
    Cloud,
    deproject,
    is_valid,
    remove_flying,
)
from dexgrasp_env.perception.plane import Plane, fit_plane, level_views, view_corrections
from dexgrasp_env.perception.robot import RobotShape
from dexgrasp_env.robot.model import compiled_robot, posed
from dexgrasp_env.sensing.raycast import RayCameras


def as_cloud(points, camera=None, views=(0.0, 0.0, 1.0)):
    points = np.asarray(points, float)
    n = len(points)
    camera = np.zeros(n, np.int32) if camera is None else camera
    views = np.broadcast_to(np.asarray(views, float), (n, 3)).copy()
    return Cloud(points, views, np.full(n, 0.6), camera, np.arange(n, dtype=np.int32))


def table_points(rng, n=5000, noise=0.0, height=0.0):
    return np.stack(
        [rng.uniform(0.2, 0.8, n), rng.uniform(-0.4, 0.4, n), height + noise * rng.standard_normal(n)], -1
    )


def test_flying_pixels_go_and_surfaces_stay():
    depth = np.full((1, 20, 20), 0.8, np.float32)
    depth[:, 5:15, 5:15] = 0.5
    clean = depth.copy()
    depth[0, 5, 8], depth[0, 2, 2] = 0.65, np.nan
    out = remove_flying(depth)
    assert np.isinf(out[0, 5, 8])
    assert np.isinf(out[0, 2, 2])
    assert np.isfinite(out).sum() == 398
    assert np.array_equal(remove_flying(clean), clean)


def test_plane_is_found_among_outliers_and_repeats_by_seed():
    rng = np.random.default_rng(0)
    points = table_points(rng, noise=0.001)
    points[:, 2] += 0.02 + 0.05 * (points[:, 0] - 0.5)
    clutter = rng.uniform([0.4, -0.1, -0.05], [0.6, 0.1, 0.06], (2500, 3))
    both = np.concatenate([points, clutter])
    plane = fit_plane(both, np.random.default_rng(1))
    true = np.array([-0.05, 0, 1]) / np.sqrt(1 + 0.05**2)
    assert np.degrees(np.arccos(plane.normal @ true)) < 0.2
    assert abs(plane.heights(np.array([0.5, 0, 0.02]))) < 5e-4
    assert plane.rms == pytest.approx(0.001, rel=0.2)
    assert np.array_equal(fit_plane(both, np.random.default_rng(1)).normal, plane.normal)


def test_no_plane_where_there_is_none():
    rng = np.random.default_rng(0)
    assert fit_plane(np.empty((0, 3)), rng) is None
    assert fit_plane(table_points(rng, height=0.3), rng) is None
    wall = table_points(rng)[:, [2, 1, 0]] * [1, 1, 0.05]
    assert fit_plane(wall, rng) is None
    assert fit_plane(np.full((500, 3), 0.01), rng) is None


def test_levelling_undoes_tilt_and_height_of_a_view():
    rng = np.random.default_rng(0)
    true = np.concatenate([table_points(rng), [[0.5, 0, 0.1]], table_points(rng), [[0.5, 0, 0.1]]])
    camera = np.repeat([0, 1], 5001).astype(np.int32)
    wrong = true.copy()
    tilt = trimesh.transformations.rotation_matrix(np.radians(0.3), [1, 0.5, 0], [1.0, 0.4, 0.5])[:3, :3]
    wrong[5001:] = (true[5001:] - [1, 0.4, 0.5]) @ tilt.T + [1, 0.4, 0.501]
    plane = Plane(np.array([0, 0, 1.0]), 0.0, 0.0)
    cloud = as_cloud(wrong, camera)
    level = level_views(cloud, view_corrections(cloud, plane, 2)).points
    assert np.abs(level[:5001] - true[:5001]).max() < 1e-9
    assert np.abs(level[5001:-1, 2]).max() < 1e-6
    assert abs(level[-1, 2] - 0.1) < 1e-4


def test_all_that_cameras_see_of_the_robot_over_the_table_is_its_own():
    cameras, model = CELL.make_cameras(), compiled_robot(CELL)
    data = posed(model, [0.1, 0.6, 0.0, -2.0, 0.0, 2.6, 0.8, *HOME[7:]])
    depths, own = RayCameras(model, cameras).render(data), RobotShape(model).at(data, 0.005)
    for depth, camera in zip(depths, cameras, strict=True):
        seen = deproject(depth, camera)[is_valid(depth)]
        assert len(seen) > 1000
        assert own(seen).all()


def test_hull_reaches_the_table_and_forgets_noise():
    plane = Plane(np.array([0, 0, 1.0]), 0.0, 0.0)
    box = trimesh.creation.box([0.05, 0.05, 0.1])
    surface = box.sample(4000, seed=0) + np.array([0, 0, 0.05])
    seen = surface[surface[:, 2] > 0.005]
    true = ConvexHull(cloud_corners(seen, plane)).volume / box.volume
    assert true == pytest.approx(1.0, abs=0.02)
    noisy = seen + 0.001 * np.random.default_rng(0).standard_normal(seen.shape)
    told = replace(plane, rms=0.001)
    raw, trimmed = (ConvexHull(cloud_corners(noisy, given)).volume for given in (plane, told))
    assert raw / box.volume > 1.12
    assert abs(trimmed / box.volume - 1.0) < 0.7 * (raw / box.volume - 1.0)
    assert cloud_corners(np.zeros((9, 3))) is None
    assert cloud_corners(np.zeros((2, 3))) is None
