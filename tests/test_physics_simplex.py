import numpy as np
import pytest
from scipy.optimize import linprog

from dexgrasp.mechanics.simplex import empty_simplex, restart, solve


def add(lp, A, b):
    """Append rows A z >= b."""
    old, new = lp.size[0], lp.size[0] + len(A)
    lp.A[old:new], lp.b[old:new], lp.size[0] = A, b, new


@pytest.mark.parametrize("unknowns", [3, 4, 7])
def test_answers_are_those_of_highs_and_their_multipliers_prove_them(unknowns):
    rng, feasible = np.random.default_rng(unknowns), 0
    lp, last = empty_simplex(unknowns, 50), np.eye(unknowns)[-1]
    for _ in range(100):
        A = rng.normal(size=(50, unknowns))
        b = 0.3 * rng.normal(size=50) - rng.choice([0.0, 0.5, 1.0])
        restart(lp, 3.0)
        add(lp, A[:40], b[:40])
        first = solve(lp, 1e-9)
        add(lp, A[40:], b[40:])  # goes on from there
        found = first and solve(lp, 1e-9)
        expected = linprog(-last, -A, -b, bounds=[(-1e4, 1e4)] * (unknowns - 1) + [(None, 3.0)])
        assert found == (expected.status == 0)
        if found:
            feasible += 1
            assert lp.z[-1] == pytest.approx(-expected.fun, abs=1e-6)
            assert (A @ lp.z >= b - 1e-6).all()
            assert lp.multipliers.min() >= 0.0
            pulls = sum(m * A[r] for r, m in zip(lp.basis, lp.multipliers, strict=True) if r >= 0)
            np.testing.assert_allclose(pulls if lp.z[-1] < 3.0 else -last, -last, atol=1e-7)
    assert 0 < feasible < 100


def test_nothing_but_the_bound_is_the_bound():
    lp = empty_simplex(4, 1)
    restart(lp, 2.5)
    assert solve(lp, 1e-9)
    assert lp.z[3] == 2.5
