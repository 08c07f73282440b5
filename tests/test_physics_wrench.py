import numpy as np
import pytest
from oracles import closed, pyramid_violation, random_grasps

from dexgrasp.mechanics.wrench import solve_wrench_qp


def test_forces_are_feasible_and_their_residual_decides_as_the_sweep():
    P, N = random_grasps(60, 1)
    decided = closed(P, N, 0.5)
    for p, n, feasible in zip(P, N, decided, strict=True):
        answer = solve_wrench_qp(p, n, 0.5)
        assert pyramid_violation(answer.forces, n, 0.5).max() < 1e-9
        assert (-(answer.forces * n).sum(-1)).min() > 1 - 1e-9
        assert (answer.residual < 1e-6) == feasible


@pytest.mark.parametrize("n", [1, 2, 4, 6])
def test_any_number_of_contacts(n):
    rng = np.random.default_rng(n)
    p = rng.normal(size=(n, 3))
    p /= np.linalg.norm(p, axis=1, keepdims=True)
    answer = solve_wrench_qp(0.05 * p, p, 0.5, f_min=2.0)
    assert answer.forces.shape == (n, 3)
    assert (-(answer.forces * p).sum(-1)).min() >= 2 - 1e-9
    if n == 1:
        assert answer.residual >= 4 - 1e-6
