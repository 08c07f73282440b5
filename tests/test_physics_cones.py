import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from dexgrasp.mechanics.cones import C, tangent_basis
from dexgrasp.mechanics.ratios import wrench_ratios


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
    for forces, ratios in (
        ([[-1, 0, 0], [1, 0, 0]], (0, 0)),  # balanced
        ([[0, 1, 0], [0, 1, 0]], (100, 0)),
        ([[0, 1, 0], [0, -1, 0]], (0, 100)),  # turning
    ):
        assert wrench_ratios(p, np.array(forces, float), np.zeros(3)) == pytest.approx(ratios)
