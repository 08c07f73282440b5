"""Proposals, the atlas, tip IK, and the constraints of the optimisation with their gradients."""

import itertools
from functools import cache

import mujoco
import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from robots import CELL, GRASP_FINGERS, HOME, LOWER, ROBOT, UPPER
from tables import table

from dexgrasp.geometry.mesh_distance import closest_on_mesh
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.verify.cones import conic_margin
from dexgrasp.mechanics.contacts import shape_of
from dexgrasp.mechanics.kinematics.tip_ik import solve_tips
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.planning.atlas import hand_atlas, triangle_sides
from dexgrasp.planning.constraints import evaluate, fixed_rows
from dexgrasp.planning.postures import atlas_postures
from dexgrasp.planning.proposals import SurfaceProposals
from dexgrasp.planning.settings import GraspProblem, PlannerSettings
from dexgrasp.planning.sqp import bounds_of
from dexgrasp_env.robot.model import robot_spec

TREE, SETTINGS = robot_tree(CELL), PlannerSettings()
CLOSURE, FIRST_AXIS, FIRST_PAD, FIXED_ROWS = fixed_rows(3)
MODEL = robot_spec(CELL).compile()
DATA = mujoco.MjData(MODEL)


def standing(mesh, x=0.5, y=0.0, yaw=0.4):
    """A grasp_target on the table."""
    mesh.apply_transform(trimesh.transformations.rotation_matrix(yaw, [0, 0, 1]))
    low, high = mesh.bounds
    mesh.apply_translation([x - (low + high)[0] / 2, y - (low + high)[1] / 2, -low[2]])
    return GraspTarget.of(mesh)


def stone(seed=1):
    points = np.random.default_rng(seed).normal(size=(60, 3)) * [0.025, 0.03, 0.04]
    return trimesh.convex.convex_hull(points)


SHAPES = {
    "box": lambda: standing(trimesh.creation.box((0.05, 0.08, 0.12))),
    "can": lambda: standing(trimesh.creation.cylinder(0.033, 0.1, sections=48)),
    "ball": lambda: standing(trimesh.creation.icosphere(subdivisions=2, radius=0.04)),
    "stone": lambda: standing(stone()),
    "tetrahedron": lambda: standing(trimesh.convex.convex_hull(table("tetrahedron"))),
}


@cache
def subject(name):
    return SHAPES[name]()


def tips_by_mujoco(q):
    DATA.qpos[:23] = q
    mujoco.mj_kinematics(MODEL, DATA)
    return np.array([DATA.site(f"{finger}_tip").xpos for finger in GRASP_FINGERS])


def propose(grasp_target, settings=SETTINGS, seed=0, source=None):
    return (source or SurfaceProposals()).propose(grasp_target, settings, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def proposals():
    return {name: propose(subject(name)) for name in SHAPES}


# Proposals


@pytest.mark.parametrize("name", SHAPES)
def test_proposals_lie_on_the_surface_above_the_table(name, proposals):
    found, grasp_target = proposals[name], subject(name)
    assert found.failure is None
    assert 0 < len(found.contacts) <= SETTINGS.triples
    points, normals = found.contacts.reshape(-1, 3), found.normals.reshape(-1, 3)
    assert np.abs(closest_on_mesh(grasp_target.hull, points).distances).max() < 1e-6
    assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-9)
    reach = SETTINGS.tip_radius + 0.5 * sum(SETTINGS.distance)
    # The tip that touches there: its centre stands off by its radius, and the sphere is above the table.
    standing = closest_on_mesh(grasp_target.hull, points + reach * normals).distances
    assert_allclose(standing, reach, atol=1e-6)
    assert (points[:, 2] + reach * normals[:, 2]).min() > SETTINGS.tip_radius
    apart = [
        np.linalg.norm(found.contacts[:, i] - found.contacts[:, j], axis=1)
        for i, j in ((0, 1), (0, 2), (1, 2))
    ]
    assert np.min(apart) > 0.02


# Atlas and starting postures


def test_atlas_postures_are_what_mujoco_says():
    atlas = hand_atlas(CELL)
    assert len(atlas.joints) > 5000
    rng = np.random.default_rng(0)
    for k in rng.choice(len(atlas.joints), 60, replace=False):
        q = np.concatenate([rng.uniform(LOWER[:7], UPPER[:7]), atlas.joints[k]])
        tips = tips_by_mujoco(q)
        R, p = DATA.site("palm").xmat.reshape(3, 3), DATA.site("palm").xpos
        assert_allclose(atlas.tips.centres[k], (tips - p) @ R, atol=1e-9)
        frames = [DATA.body(f"{finger}_distal").xmat.reshape(3, 3) for finger in GRASP_FINGERS]
        assert_allclose(atlas.tips.axes[k], [R.T @ frame[:, 2] for frame in frames], atol=1e-9)
        assert_allclose(atlas.tips.pads[k], [R.T @ frame[:, 0] for frame in frames], atol=1e-9)
    lower, upper = LOWER[7:], UPPER[7:]
    assert ((atlas.joints >= lower) & (atlas.joints <= upper)).all()
    assert (atlas.joints[:, 8:12] == ROBOT.hand.finger("ring").aside).all()
    assert_array_equal(atlas.search.data, triangle_sides(atlas.tips.centres))


def test_tip_ik_reaches_what_can_be_reached():
    rng, atlas, met = np.random.default_rng(3), hand_atlas(CELL), 0
    for k in rng.choice(len(atlas.joints), 40, replace=False):
        goal = HOME.copy()
        goal[7:] = atlas.joints[k]
        targets = tips_by_mujoco(goal).copy()
        q = goal.copy()
        q[TREE.moved] += rng.normal(0, 0.1, len(TREE.moved))
        q = np.clip(q, LOWER, UPPER)
        ring = q[15:19].copy()
        miss = solve_tips(q, targets, TREE, 100, 1e-4)
        assert ((q >= LOWER) & (q <= UPPER)).all()
        assert_array_equal(q[15:19], ring)
        true = np.linalg.norm(tips_by_mujoco(q) - targets, axis=1).max()
        assert miss == pytest.approx(true, abs=1e-9)
        met += true < 1e-4
    assert met >= 36


# The constraints of the optimisation


def near_contact(name, proposals, count, seed=0):
    rng = np.random.default_rng(seed)
    for posture in itertools.islice(
        atlas_postures(proposals[name], GraspProblem(subject(name), CELL, SETTINGS)), count
    ):
        q = posture.q.copy()
        q[TREE.moved] += rng.normal(0, 0.02, len(TREE.moved))
        yield np.clip(q, LOWER, UPPER)


def rows_at(q, grasp_target, settings=SETTINGS):
    problem = GraspProblem(grasp_target, CELL, settings)
    at = evaluate(
        q, TREE, grasp_target.distance.obstacle, problem.world, bounds_of(problem, 0.5), shape_of(3), True
    )
    keys = [tuple(label) for label in at.labels.tolist()]
    least = {}
    for key, value, row in zip(keys, at.values, at.rows, strict=True):
        if value < least.get(key, (np.inf,))[0]:
            least[key] = value, row
    return at, least


@pytest.mark.parametrize("name", SHAPES)
def test_gradient_of_every_row_is_its_difference(name, proposals):
    """Rows whose nearest feature or binding contact switches within the step have no gradient and are left out."""
    h, checked, kinks, closure = 1e-6, 0, 0, 0
    for q in near_contact(name, proposals, 6):
        _, here = rows_at(q, subject(name))
        difference, smooth = {key: np.zeros(23) for key in here}, set(here)
        for j in range(23):
            step = h * np.eye(23)[j]
            (_, up), (_, down) = rows_at(q + step, subject(name)), rows_at(q - step, subject(name))
            for key in list(smooth):
                if (
                    key not in up
                    or key not in down
                    or abs(up[key][0] + down[key][0] - 2 * here[key][0]) > 1e-9
                ):
                    smooth.discard(key)
                    continue
                difference[key][j] = (up[key][0] - down[key][0]) / (2 * h)
        for key in smooth:
            assert_allclose(here[key][1], difference[key], atol=3e-5, err_msg=f"{name} {key}")
        checked += len(smooth)
        kinks += len(here) - len(smooth)
        closure += (-1 - CLOSURE, -1, -1) in smooth and np.abs(difference[-1 - CLOSURE, -1, -1]).max() > 1e-4
    assert checked > 6 * FIXED_ROWS
    assert kinks < 0.15 * checked
    assert closure >= 3


@pytest.mark.parametrize("name", ["box", "stone"])
def test_values_of_the_fixed_rows_by_another_way(name, proposals):
    bounds = bounds_of(GraspProblem(subject(name), CELL, SETTINGS), 0.5)
    for q in near_contact(name, proposals, 10, seed=1):
        at, _ = rows_at(q, subject(name))
        tips = tips_by_mujoco(q)
        distance, _, normals = closest_on_mesh(subject(name).hull, tips)
        assert_allclose(at.distances, distance, atol=1e-7)
        assert_allclose(at.contacts, tips - distance[:, None] * normals, atol=1e-6)
        assert_allclose(at.values[:3], distance - bounds.low, atol=1e-7)
        assert_allclose(at.values[3:6], bounds.high - distance, atol=1e-7)
        margin = conic_margin(at.contacts, at.normals, SETTINGS.friction)
        assert abs(at.margin - margin) < 1e-5
        for i, finger in enumerate(GRASP_FINGERS):
            frame = DATA.body(f"{finger}_distal").xmat.reshape(3, 3)
            axis, pad = -frame[:, 2] @ at.normals[i], -frame[:, 0] @ at.normals[i]
            assert at.values[FIRST_AXIS + i] == pytest.approx(0.01 * (axis - bounds.cosine), abs=1e-9)
            assert at.values[FIRST_PAD + i] == pytest.approx(0.01 * (pad - bounds.pad_cosine), abs=1e-9)
