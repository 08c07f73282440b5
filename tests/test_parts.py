"""Convex parts of clouds whose hull would hold much air."""

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_array_equal
from planned import hammer

from dexgrasp.geometry.completion import target_of
from dexgrasp.geometry.convex_parts import MOST_PARTS, parts_within
from dexgrasp.geometry.hull import cloud_corners
from dexgrasp.planning.planner import Planner
from dexgrasp.planning.proposals import graspable_points
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp_env.perception.plane import Plane
from dexgrasp_env.perception.scene import ObjectCloud, Scene

TABLE = Plane(np.array([0, 0, 1.0]), 0.0, 0.0005)


def cloud(*meshes, count=1000, noise=0.0005, seed=0):
    """What cameras would see: points and normals of the outer surface, from just above the table."""
    rng = np.random.default_rng(seed)
    points, faces = trimesh.sample.sample_surface(trimesh.util.concatenate(meshes), 3 * count, seed=seed)
    normals = trimesh.util.concatenate(meshes).face_normals[faces]
    within = np.zeros(len(points), bool)
    for mesh in meshes if len(meshes) > 1 else ():
        planes = ((points[:, None] - mesh.triangles[None, :, 0]) * mesh.face_normals[None]).sum(-1)
        within |= planes.max(1) < -1e-6
    seen = np.flatnonzero(~within & (points[:, 2] > 0.005))[:count]
    return points[seen] + noise * rng.standard_normal((len(seen), 3)), normals[seen]


def parts_of(points):
    return parts_within(cloud_corners(points, TABLE), points, TABLE)[0]


def test_a_hammer_comes_apart_into_what_it_is():
    solid = hammer()
    points, normals = cloud(*solid)
    parts = parts_of(points)
    true = trimesh.boolean.union(solid)
    assert 2 <= len(parts) <= MOST_PARTS
    held = sum(trimesh.convex.convex_hull(part).volume for part in parts)
    assert held < 1.25 * true.volume < 0.75 * trimesh.convex.convex_hull(cloud_corners(points, TABLE)).volume
    target = target_of(Scene(ObjectCloud(points, normals), TABLE))
    assert np.linalg.norm(target.centre - true.center_mass) < 0.006
    inside = np.array([0.54, 0.04, 0.02])  # beside the handle: air, though within the hull
    assert target.distance.distance(inside)[0] > 0.015
    assert target.hull.contains([inside])[0]
    assert np.quantile(abs(target.distance.distance(points)), 0.95) < 0.004


@pytest.mark.parametrize(
    "solid",
    [
        trimesh.creation.box((0.06, 0.09, 0.12)),
        trimesh.creation.cylinder(0.033, 0.1),
        trimesh.creation.icosphere(3, 0.035),
        trimesh.creation.cone(0.04, 0.08),
        trimesh.creation.annulus(0.035, 0.04, 0.09),  # hollow: no plane takes its air away
    ],
    ids=["box", "can", "ball", "cone", "cup"],
)
def test_what_is_convex_or_hollow_stays_whole(solid):
    solid = solid.copy()
    solid.apply_translation([0.5, 0.0, -solid.bounds[0, 2]])
    points, normals = cloud(solid, noise=0.001)
    assert len(parts_of(points)) == 1
    assert_array_equal(parts_of(points)[0], cloud_corners(points, TABLE))
    target = target_of(Scene(ObjectCloud(points, normals), TABLE))
    assert target.parts == (target.hull,)


def test_no_grasp_lies_on_a_cups_mouth():
    cup = trimesh.creation.annulus(0.035, 0.039, 0.09)
    cup.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    cup.apply_translation([0.5, 0.0, 0.039])
    points, normals = cloud(cup)
    target = target_of(Scene(ObjectCloud(points, normals), TABLE))
    mouth, side, low = [0.5, -0.045, 0.045], [0.539, 0.0, 0.039], [0.535, 0.0, 0.004]
    assert_array_equal(target.was_seen(np.array([mouth, side, low])), [False, True, True])
    contacts, _ = graspable_points(target, PlannerSettings(), np.random.default_rng(0))
    assert len(contacts) > 10
    assert target.was_seen(contacts).all()
    grasp = Planner().plan(target).grasp
    assert grasp is not None
    assert target.was_seen(grasp.contacts).all()
