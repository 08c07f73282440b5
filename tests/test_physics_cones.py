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


@pytest.mark.parametrize("n", [[1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
def test_basis_is_continuous_at_the_normals_of_boxes(n):
    near = np.array(n) + 1e-7 * unit(np.random.default_rng(1), 50)
    near /= np.linalg.norm(near, axis=1, keepdims=True)
    for at, moved in zip(tangent_basis([n]), tangent_basis(near), strict=True):
        assert_allclose(moved, np.broadcast_to(at, moved.shape), atol=1e-5)


def test_ratios():
    p = np.array([[0.05, 0, 0], [-0.05, 0, 0]])
    balanced = wrench_ratios(p, np.array([[-1.0, 0, 0], [1, 0, 0]]), np.zeros(3))
    assert balanced == (0.0, 0.0)
    one_sided = wrench_ratios(p, np.array([[0.0, 1, 0], [0, 1, 0]]), np.zeros(3))
    assert one_sided == (pytest.approx(100), pytest.approx(0))
    turning = wrench_ratios(p, np.array([[0.0, 1, 0], [0, -1, 0]]), np.zeros(3))
    assert turning == (pytest.approx(0), pytest.approx(100))
