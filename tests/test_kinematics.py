"""Kinematics and clearances against MuJoCo's, and gradients against differences."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import mujoco
import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from refusals import refused
from robots import BODIES, CELL, GRASP_FINGERS, HOME, LOWER, UPPER

from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.mechanics.kinematics import geom_distance
from dexgrasp.mechanics.kinematics.clearance import OBJECT, SELF, TABLE, clearances
from dexgrasp.mechanics.kinematics.forward import body_frames, contact_jacobian, fingertips, tip_jacobian
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame, reach_palm, solve_palm
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.mechanics.kinematics.world import make_world
from dexgrasp_env.robot.model import robot_spec

MOUNTS = ("palm_normal", "fingers_along")
NEAR = 0.02
HULL = trimesh.convex.convex_hull(
    np.random.default_rng(4).normal(size=(30, 3)) * [0.02, 0.03, 0.05] + [0.5, 0.05, 0.1]
)
SHAPE = ConvexDistance.from_points(HULL.vertices)


@lru_cache
def world(mount):
    spec = robot_spec(CELL.mounted(mount))
    mesh = spec.add_mesh(name="hull")
    mesh.uservert, mesh.userface = HULL.vertices.ravel(), HULL.faces.ravel()
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    spec.worldbody.add_geom(name="object", type=mujoco.mjtGeom.mjGEOM_MESH, meshname="hull")
    spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    model = spec.compile()
    return model, mujoco.MjData(model)


def placed(q, mount="palm_normal"):
    model, data = world(mount)
    data.qpos[:23] = q
    mujoco.mj_forward(model, data)
    return model, data


def anywhere(rng, count):
    return rng.uniform(LOWER, UPPER, (count, 23))


def around_the_object(rng, count):
    """Palms pointing down to every side, near the object and the table, with random fingers."""
    found = []
    while len(found) < count:
        q = HOME.copy()
        down = np.array([0.0, 0.0, -1.0]) + 0.5 * rng.normal(size=3)
        down /= np.linalg.norm(down)
        fingers = np.cross(rng.normal(size=3), down)
        fingers /= np.linalg.norm(fingers)
        R = np.stack([down, np.cross(fingers, down), fingers], axis=1)
        p = HULL.centroid + 0.02 * rng.normal(size=3) - (0.08 + 0.06 * rng.random()) * down
        p[2] -= 0.06 * rng.integers(2)
        if reach_palm(q, R, p, robot_tree(CELL)):
            q[7:] = rng.uniform(LOWER[7:], UPPER[7:])
            found.append(q)
    return found


def true_distances(q, tips_touch=True):
    """MuJoCo's distances between the true shapes, by the same keys; far ones are left out."""
    model, data = placed(q)
    geoms = {
        i: [g for g in range(model.ngeom) if model.geom_contype[g] and model.geom_bodyid[g] == model.body(name).id]
        for i, name in enumerate(BODIES)
    }  # fmt: skip
    tips = {model.geom(f"{finger}_tip").id for finger in GRASP_FINGERS} if tips_touch else set()
    fromto = np.zeros(6)

    def least(one, two):
        return min(
            (mujoco.mj_geomDistance(model, data, a, b, 0.05, fromto) for a in one for b in two), default=0.05
        )

    found = {}
    for i in range(2, len(BODIES)):
        found[OBJECT, i, -1] = least([g for g in geoms[i] if g not in tips], [model.geom("object").id])
        if i >= 3:  # the others stand on the plinth
            found[TABLE, i, -1] = least(geoms[i], [model.geom("table").id])
    for a, b in robot_tree(CELL).pairs.tolist():
        found[SELF, a, b] = least(geoms[a], geoms[b])
    return found


@pytest.mark.parametrize("mount", MOUNTS)
def test_frames_tips_and_their_jacobians_are_mujocos(mount):
    tree, J, of_hand = robot_tree(CELL.mounted(mount)), np.zeros((3, 23)), np.empty((3, 3, 23))
    for q in anywhere(np.random.default_rng(0), 40):
        model, data = placed(q, mount)
        frames, tips = body_frames(q, tree), fingertips(q, tree)
        ids = [model.body(name).id for name in BODIES]
        assert_allclose(frames.p, data.xpos[ids], atol=1e-12)
        assert_allclose(frames.R.reshape(-1, 9), data.xmat[ids], atol=1e-12)
        R_palm, p_palm = palm_frame(q, tree)
        assert_allclose(R_palm.ravel(), data.site("palm").xmat, atol=1e-12)
        assert_allclose(p_palm, data.site("palm").xpos, atol=1e-12)
        ours = tip_jacobian(tree, frames, tips)
        contact_jacobian(tree, frames, tips, tips, tree.palm, of_hand)
        assert_array_equal(of_hand, np.where(np.arange(23) < 7, 0.0, ours))
        for i, finger in enumerate(GRASP_FINGERS):
            assert_allclose(tips[i], data.site(f"{finger}_tip").xpos, atol=1e-12)
            mujoco.mj_jacSite(model, data, J, None, model.site(f"{finger}_tip").id)
            assert_allclose(ours[i], J, atol=1e-12)


@pytest.mark.parametrize("mount", MOUNTS)
def test_palm_ik_reaches_poses_that_can_be_reached(mount):
    """Goals are made from configurations, so every one can be reached; MuJoCo judges."""
    rng, tree, met = np.random.default_rng(2), robot_tree(CELL.mounted(mount)), 0
    for _ in range(60):
        goal = HOME.copy()
        goal[:7] = np.clip(HOME[:7] + rng.uniform(-0.6, 0.6, 7), LOWER[:7] + 0.05, UPPER[:7] - 0.05)
        R, p = palm_frame(goal, tree)
        q = HOME.copy()
        error = solve_palm(q, R, p, tree, 100, 1e-5)
        _, data = placed(q, mount)
        off = np.linalg.norm(data.site("palm").xpos - p)
        turned = np.arccos(np.clip((np.trace(R.T @ data.site("palm").xmat.reshape(3, 3)) - 1) / 2, -1, 1))
        assert np.hypot(off, 0.15 * turned) <= 1.02 * error + 1e-6  # it never claims more than it has reached
        assert ((q >= LOWER) & (q <= UPPER)).all()
        assert_array_equal(q[7:], HOME[7:])
        met += error < 1e-4
    assert met >= 57


def test_clearances_are_mujocos_distances_of_the_true_shapes():
    """Of more parts than a world has room for at first, of one that was pickled for another process, in threads."""
    rng, tree = np.random.default_rng(5), robot_tree(CELL)
    far = ConvexDistance.from_points(np.add(HULL.vertices, [0.0, 5.0, 0.0]))
    worlds = [make_world(CELL, SHAPE), make_world(CELL, SHAPE, ConvexDistance.union([far] * 70))]
    kept = pickle.dumps(worlds[0])
    make_world.cache_clear()
    worlds.append(pickle.loads(kept))
    assert worlds[2].model != worlds[0].model
    seen, alone, postures = (
        {OBJECT: 0, TABLE: 0, SELF: 0},
        [],
        [*around_the_object(rng, 60), *anywhere(rng, 30)],
    )
    for q in postures:
        values, labels = clearances(q, tree, worlds[0], NEAR, True)
        ours, true = dict(zip(map(tuple, labels.tolist()), values, strict=True)), true_distances(q)
        assert ours.keys() == {key for key, distance in true.items() if distance < NEAR}
        for key, value in ours.items():
            near = 1e-6 if value > 0.0 else 0.05 * -value  # how deep shapes overlap is known less well
            assert value == pytest.approx(true[key], abs=near), key
            seen[key[0]] += value > 0.0
        for world in worlds[1:]:
            assert_array_equal(clearances(q, tree, world, NEAR, True)[0], values)
        alone.append(values.tolist())
    with ThreadPoolExecutor(4) as pool:
        shared = pool.map(lambda q: clearances(q, tree, worlds[0], NEAR, True)[0].tolist(), 4 * postures)
        assert list(shared) == 4 * alone
    assert seen[OBJECT] > 60
    assert seen[TABLE] > 30
    assert seen[SELF] > 100


def test_a_library_without_the_distance_is_said_so(monkeypatch):
    monkeypatch.setattr(geom_distance, "_NAME", "mj_none")
    with refused("MuJoCo's library has no mj_none"):
        geom_distance._bound()
