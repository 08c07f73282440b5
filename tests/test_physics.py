"""Mechanics of a grasp against oracles: closure, margins, ratios; and the forces that squeeze and bear it."""

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from oracles import closed, pyramid_violation, random_grasps, sample_box, sample_can
from tables import table

from dexgrasp.mechanics.closure import closure_sweep
from dexgrasp.mechanics.cones import C, tangent_basis
from dexgrasp.mechanics.contacts import Contacts, shape_of
from dexgrasp.mechanics.equilibrium import grasp_map, rms_radius
from dexgrasp.mechanics.internal_force import RESERVED, firmest_squeeze
from dexgrasp.mechanics.margin import UNDEFINED, cone_margin, margins
from dexgrasp.mechanics.strength import load_of
from dexgrasp.mechanics.wrench import solve_wrench_qp, wrench_ratios


def with_noise(points, normals, rng):
    """The same with 2 mm on points and about 6 deg on normals."""
    turned = normals + 0.1 * rng.normal(size=normals.shape)
    return points + 0.002 * rng.normal(size=points.shape), turned / np.linalg.norm(
        turned, axis=1, keepdims=True
    )


@pytest.mark.parametrize("shape", ["box", "noisy box", "can", "grid"])
def test_decision_agrees_with_the_quadratic_programme(shape):
    rng = np.random.default_rng(4)
    points, normals = sample_can(256, rng) if shape == "can" else sample_box(256, rng)
    if shape == "noisy box":
        points, normals = with_noise(points, normals, rng)
    if shape == "grid":
        points = np.round(points / 0.02) * 0.02  # points coincide and lie on lines
    triples = np.sort(np.argsort(rng.random((2000, 256)), axis=1)[:, :3])
    P, N, scale = points[triples], normals[triples], rms_radius(points)
    decided = closed(P, N, 0.5, scale)
    residuals = [solve_wrench_qp(p, n, 0.5, length_scale=scale).residual for p, n in zip(P, N, strict=True)]
    assert (decided != (np.array(residuals) < 1e-6)).sum() <= 2  # forces of some are too large for a QP
    assert 100 < decided.sum() < 800


def test_sweep_is_the_decision_of_every_triple():
    points, normals = sample_box(40, np.random.default_rng(5))
    points = np.round(points, 2)
    triples = np.array(list(itertools.combinations(range(40), 3)))
    apart = np.linalg.norm(points[triples] - points[triples][:, [1, 2, 0]], axis=-1).min(1) >= 0.03
    scale = 0.08
    decided = closed(points[triples], normals[triples], 0.5, scale)
    swept = closure_sweep(points, normals, 0.5, length_scale=scale)
    assert swept.dtype == np.int32
    assert_array_equal(swept, triples[decided & apart])


def test_forces_are_feasible_and_their_residual_decides_as_the_sweep():
    P, N = random_grasps(60, 1)
    decided = closed(P, N, 0.5)
    for p, n, feasible in zip(P, N, decided, strict=True):
        answer = solve_wrench_qp(p, n, 0.5)
        assert pyramid_violation(answer.forces, n, 0.5).max() < 1e-9
        assert (-(answer.forces * n).sum(-1)).min() > 1 - 1e-9
        assert (answer.residual < 1e-6) == feasible


def unit(rng, *shape):
    v = rng.normal(size=(*shape, 3))
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def test_basis_is_right_handed_for_every_normal():
    n = np.concatenate([unit(np.random.default_rng(0), 1000), np.eye(3), -np.eye(3), [C], [-np.array(C)]])
    t1, t2 = tangent_basis(n)
    assert_allclose(np.cross(t1, t2), n, atol=1e-12)
    assert_allclose((t1 * t2).sum(-1), 0, atol=1e-12)
    assert_array_equal(t1, tangent_basis(n)[0])


def test_ratios():
    p = np.array([[0.05, 0, 0], [-0.05, 0, 0]])
    for forces, ratios in table("wrench_ratios"):
        assert wrench_ratios(p, np.array(forces, float), np.zeros(3)) == pytest.approx(ratios)


def test_a_margin_is_closure_and_at_most_one():
    P, N = random_grasps(5000, 4)
    cone = margins(P, N, 0.5)
    assert closed(P[cone > 1e-9], N[cone > 1e-9], 0.5).all()
    assert not closed(P[cone < -1e-3], N[cone < -1e-3], 0.5 / 2**0.5).any()
    assert cone.max() <= 1.0


def test_axis_aligned_and_degenerate_grasps_give_finite_answers():
    points, normals = sample_box(30, np.random.default_rng(5))
    triples = np.random.default_rng(6).integers(0, 30, (500, 3))
    for p, n in zip(np.round(points, 2)[triples], normals[triples], strict=True):
        assert all(np.isfinite(part).all() for part in cone_margin(p, n, 0.5, shape_of(3)))
    line = np.array(table("in_line"))
    value, dp, _, _ = cone_margin(line, np.eye(3), 0.5, shape_of(3))
    assert value == UNDEFINED
    assert not dp.any()


POINTS = np.array(table("squeezed"))
NORMALS = np.array(table("squeezed_normals"))
COM = np.array([0.0, 0, 0.05])
MU, MASS = 0.5, 0.3


def random_grasp(rng):
    """Contacts on opposite sides of a body of some width, turned and moved at random."""
    points = POINTS + rng.normal(size=(3, 3)) * 0.01
    normals = NORMALS + rng.normal(size=(3, 3)) * 0.2
    J = np.zeros((3, 3, 12))
    for i in range(3):
        J[i, :, 4 * i : 4 * i + 4] = 0.06 * rng.normal(size=(3, 4))
    return (
        points,
        normals / np.linalg.norm(normals, axis=1, keepdims=True),
        J,
        COM + rng.normal(size=3) * 0.01,
    )


def touching_planes(normals, count):
    """Inward normals (3, count, 3) of planes that touch the cones of MU, made without the package's tangents."""
    a = np.cross(normals, normals[:, [1, 2, 0]] + [0.3, -0.2, 0.5])
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b = np.cross(normals, a)
    turn = 2 * np.pi * np.arange(count) / count
    planes = -MU * normals[:, None] + np.cos(turn)[:, None] * a[:, None] + np.sin(turn)[:, None] * b[:, None]
    return planes / np.sqrt(1 + MU * MU)


def contacts(points, normals, J, centre=COM, mass=MASS, limit=0.7, mu=MU):
    """Contacts of an object in the hand."""
    limits, gravity = np.full(J.shape[2], limit), np.array([0.0, 0.0, -9.81 * mass])
    return Contacts(points, normals, J, limits, np.full(3, mu), centre, gravity)


def highs(points, normals, J, centre, limit, mass=MASS, count=150):
    """The largest D by a linear programme in all nine forces, with the cones as `count` planes each."""
    from scipy.optimize import linprog

    G, weight = grasp_map(points, centre, 0.03), 9.81 * mass
    B = np.linalg.pinv(G)[:, :3].reshape(3, 3, 3)
    rows, bound = [], []
    for i, planes in enumerate(touching_planes(normals, count)):
        for a in planes:
            row = np.zeros(10)
            row[3 * i : 3 * i + 3], row[9] = -a, weight * np.linalg.norm(B[i].T @ a)
            rows.append(row)
            bound.append(0.0)
        for j in range(J.shape[2]):
            answer = weight * np.linalg.norm(B[i].T @ J[i, :, j])
            for sign in (1.0, -1.0):
                for share, free in ((0.0, 0.0), (1.0, RESERVED)):  # as it holds; as it answers a larger push
                    row = np.zeros(10)
                    row[3 * i : 3 * i + 3], row[9] = sign * J[i, :, j], share * answer
                    rows.append(row)
                    bound.append(limit + free * answer)
    equal = np.c_[G, np.zeros(6)]
    answer = linprog(
        np.r_[np.zeros(9), -1.0], np.array(rows), bound, equal, np.r_[0, 0, weight, 0, 0, 0],
        bounds=[(None, None)] * 9 + [(None, 10.0)],
    )  # fmt: skip
    return answer.x[9] if answer.status == 0 else None


@pytest.mark.parametrize(("mass", "count"), [(MASS, 10), (0.1 * MASS, 6)])
def test_the_firmest_squeeze_is_the_linear_programmes(mass, count):
    rng, compared = np.random.default_rng(0), 0
    for _ in range(count):
        points, normals, J, centre = random_grasp(rng)
        best = highs(points, normals, J, centre, 0.7, mass)
        grasp = contacts(points, normals, J, centre, mass)
        mine = firmest_squeeze(grasp)
        if best is None or best < 0.0:
            assert mine.push == 0.0
            assert mine.share < 1.0
            continue
        compared += 1
        assert mine.share == 1.0
        assert mine.load == pytest.approx(load_of(grasp, mine.forces), abs=1e-4)
        assert mine.push == pytest.approx(best, rel=2e-3, abs=2e-3)
    assert compared > 3
