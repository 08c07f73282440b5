import numpy as np
from oracles import closed, random_grasps, sample_box

from dexgrasp.mechanics.contacts import shape_of
from dexgrasp.mechanics.margin import UNDEFINED, cone_margin, margins, margins_to


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


def test_axis_aligned_and_degenerate_grasps_give_finite_answers():
    points, normals = sample_box(30, np.random.default_rng(5))
    triples = np.random.default_rng(6).integers(0, 30, (500, 3))
    for p, n in zip(np.round(points, 2)[triples], normals[triples], strict=True):
        assert all(np.isfinite(part).all() for part in cone_margin(p, n, 0.5, shape_of(3)))
    line = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]])
    value, dp, _, _ = cone_margin(line, np.eye(3), 0.5, shape_of(3))
    assert value == UNDEFINED
    assert not dp.any()
