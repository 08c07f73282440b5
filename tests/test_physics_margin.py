import numpy as np
import pytest
from oracles import closed, directional_error, random_grasps, sample_box

from dexgrasp.grasp.verify.cones import conic_margin
from dexgrasp.mechanics.contacts import shape_of
from dexgrasp.mechanics.margin import UNDEFINED, cone_margin, margins, margins_to


def test_cone_margin_is_the_cone_programme():
    P, N = random_grasps(150, 1)
    values = margins(P, N, 0.5)
    for p, n, known in zip(P, N, values, strict=True):
        value, _, _, f = cone_margin(p, n, 0.5, shape_of(3))
        assert value == known
        assert value == pytest.approx(conic_margin(p, n, 0.5), rel=1e-6, abs=1e-6)
        np.testing.assert_allclose(f.sum(0), 0, atol=1e-8)
        np.testing.assert_allclose(np.cross(p, f).sum(0), 0, atol=1e-8)
        press = -(f * n).sum(-1)
        assert press.sum() == pytest.approx(1)
        slack = press - np.linalg.norm(f + press[:, None] * n, axis=-1) / 0.5
        assert 3 * slack.min() == pytest.approx(value, rel=1e-7, abs=1e-7)


def test_gradients_against_finite_differences():
    rng, errors = np.random.default_rng(3), []
    for p, n in zip(*random_grasps(200, 2), strict=True):
        turn = np.cross(rng.normal(size=(3, 3)), n)
        _, dp, dn, _ = cone_margin(p, n, 0.5, shape_of(3))
        errors.append(directional_error(_margin, (p, n), (dp, dn), (0.05 * rng.normal(size=(3, 3)), turn)))
    assert np.percentile(errors, 99) < 1e-3
    assert np.median(errors) < 1e-5


def _margin(points, normals):
    return cone_margin(points, normals / np.linalg.norm(normals, axis=1, keepdims=True), 0.5, shape_of(3))[0]


def test_a_margin_is_closure_and_at_most_one():
    P, N = random_grasps(5000, 4)
    cone = margins(P, N, 0.5)
    assert closed(P[cone > 1e-9], N[cone > 1e-9], 0.5).all()
    assert not closed(P[cone < -1e-3], N[cone < -1e-3], 0.5 / 2**0.5).any()
    assert cone.max() <= 1.0


def test_rough_margins_are_a_little_high_and_refuse_what_has_no_closure():
    P, N = random_grasps(2000, 5)
    exact, rough = margins(P, N, 0.5), margins_to(P, N, 0.5, shape_of(3), 1e-2, 0.0)
    closed = exact > 0.0
    assert 0.1 < closed.mean() < 0.9
    assert (rough >= exact - 1e-9).all()
    assert (rough[closed] <= exact[closed] + 1e-2).all()
    assert (rough[exact < -1e-2] <= 0.0).all()


def test_best_grasp_has_margin_one():
    n = np.array([[np.cos(a), np.sin(a), 0.0] for a in 2 * np.pi / 3 * np.arange(3)])
    assert cone_margin(0.03 * n, n, 0.5, shape_of(3))[0] == pytest.approx(1.0)


def test_axis_aligned_and_degenerate_grasps_give_finite_answers():
    points, normals = sample_box(30, np.random.default_rng(5))
    triples = np.random.default_rng(6).integers(0, 30, (500, 3))
    for p, n in zip(np.round(points, 2)[triples], normals[triples], strict=True):
        assert all(np.isfinite(part).all() for part in cone_margin(p, n, 0.5, shape_of(3)))
    line = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]])
    value, dp, _, _ = cone_margin(line, np.eye(3), 0.5, shape_of(3))
    assert value == UNDEFINED
    assert not dp.any()


def test_more_contacts_do_not_lose_closure():
    n = np.concatenate([np.eye(3), -np.eye(3)])
    assert conic_margin(0.05 * n, n, 0.5) == pytest.approx(1.0)
    assert conic_margin(np.eye(3), np.tile([0, 0, 1.0], (3, 1)), 0.5) is None  # all on one face
