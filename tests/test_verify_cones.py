"""The judge's programmes: the same as on fine pyramids, refused where open; its distances those of MuJoCo."""

from itertools import combinations

import daqp
import mujoco
import numpy as np
import pytest
from oracles import random_grasps

from dexgrasp.grasp.verify import cones
from dexgrasp.grasp.verify.cones import conic_margin, conic_residual, largest_push, pyramid_forces, wrench_map
from dexgrasp.grasp.verify.distances import Distances
from dexgrasp_env.poses import quat_to_matrix

FACES = 256


def faces(n, mu):
    """Rows (3 FACES, 9), at most 0 for forces within pyramids about the cones."""
    rows = np.zeros((3, FACES, 3, 3))
    angle = 2 * np.pi * np.arange(FACES)[:, None] / FACES
    for i, normal in enumerate(n):
        u, v, _ = np.linalg.svd(np.eye(3) - np.outer(normal, normal))[0].T
        rows[i, :, i] = np.cos(angle) * u + np.sin(angle) * v + mu * normal
    return rows.reshape(-1, 9)


def test_the_residual_is_as_on_fine_pyramids():
    compared = 0
    for p, n in zip(*random_grasps(60, 2), strict=True):
        G, A = wrench_map(p, p.mean(0)), np.concatenate([-cones.press_rows(n), faces(n, 0.5)])
        b = np.r_[-np.ones(3), np.zeros(3 * FACES)]
        H, below, sense = G.T @ G + 1e-9 * np.eye(9), np.full(len(b), -1e30), np.zeros(len(b), np.int32)
        x, _, flag, _ = daqp.solve(H, np.zeros(9), A, b, below, sense)
        if flag > 0:  # it finds an end
            compared += 1
            assert ((G @ x) ** 2).sum() == pytest.approx(conic_residual(p, n, 0.5), rel=2e-2, abs=1e-5)
    assert compared >= 25


def test_what_a_solver_leaves_open_is_not_shown(monkeypatch):
    p, n = random_grasps(1, 5)
    p, n = p[0], n[0]
    for x in (np.full(15, np.nan), np.zeros(15), np.arange(15.0)):
        monkeypatch.setattr(cones, "_minimise", lambda P, q, x=x, **_: (x[: len(q)], False))
        assert conic_margin(p, n, 0.5) is None
        assert not conic_residual(p, n, 0.5) < 1e-6
        assert largest_push(np.zeros((6, 9)), n, 0.5, np.zeros((1, 9)), (np.zeros(6), np.ones(6))) is None


def test_forces_of_eq_4_press_within_their_pyramids():
    for p, n in zip(*random_grasps(10, 4), strict=True):
        f = pyramid_forces(p, n, 0.5)
        press = -(f * n).sum(1)
        assert (press >= 1.0 - 1e-6).all()
        assert (np.linalg.norm(f + press[:, None] * n, axis=1) <= 2**0.5 * 0.5 * press + 1e-6).all()


def test_distances_are_mujocos():
    rng, spec = np.random.default_rng(0), mujoco.MjSpec()
    spec.add_mesh(name="it", uservert=rng.normal(0.0, 0.02, 60))
    for kind in (0, 2, 3, 4, 5, 6, 7):
        spec.worldbody.add_geom(type=kind, size=[0.02, 0.03, 0.015], meshname="it" if kind == 7 else "")
    model = spec.compile()
    data, grown = mujoco.MjData(model), np.array([0.0, 0.0, 0.0, 1.5e-4, 2.5e-5, 0.0, 0.0])  # m
    for places in rng.normal(0.0, 0.03, (12, 7, 3)):
        data.geom_xpos = places
        data.geom_xmat = [quat_to_matrix(q / np.linalg.norm(q)).ravel() for q in rng.normal(size=(7, 4))]
        for pair in combinations(range(7), 2):
            true = mujoco.mj_geomDistance(model, data, *pair, 1.0, None)
            found = Distances(model, data).apart(*pair)
            assert found <= true + 1e-6
            assert found >= true - grown[[*pair]].sum() - 1e-6 or true < 0.0
