import numpy as np
import pytest
from scipy.optimize import linprog

from dexgrasp.physics.simplex import maximise_last


@pytest.mark.parametrize("seed", range(4))
def test_answers_are_those_of_highs(seed):
    rng, feasible = np.random.default_rng(seed), 0
    for _ in range(40):
        A = rng.normal(size=(30, 4))
        b = 0.3 * rng.normal(size=30) - rng.choice([0.0, 0.3])
        z = np.empty(4)
        found = maximise_last(A, b, 30, 3.0, z)
        expected = linprog([0, 0, 0, -1], -A, -b, bounds=[(-1e4, 1e4)] * 3 + [(None, 3.0)])
        assert found == (expected.status == 0)
        if found:
            feasible += 1
            assert z[3] == pytest.approx(-expected.fun, abs=1e-6)
            assert (A @ z >= b - 1e-6).all()
    assert 0 < feasible < 40 or seed


def test_nothing_but_the_bound_is_the_bound():
    z = np.empty(4)
    assert maximise_last(np.zeros((0, 4)), np.zeros(0), 0, 2.5, z)
    assert z[3] == 2.5
