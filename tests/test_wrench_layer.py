import numpy as np
import pytest
from refusals import refused

torch = pytest.importorskip("torch")

from oracles import pyramid_violation  # noqa: E402

from dexgrasp.learning.cvae.wrench_layer import wrench_layer  # noqa: E402
from dexgrasp.mechanics.wrench import solve_wrench_qp  # noqa: E402


def contacts(B, N=3, seed=0):
    rng = np.random.default_rng(seed)
    points, normals = 0.05 * rng.normal(size=(B, N, 3)), rng.normal(size=(B, N, 3))
    return torch.tensor(points, requires_grad=True), torch.tensor(normals, requires_grad=True)


def layer(points, normals, mu):
    return wrench_layer(points, torch.nn.functional.normalize(normals, dim=-1), mu)


@pytest.mark.parametrize("contact_count", [2, 3, 4])
def test_gradcheck(contact_count):
    points, normals = contacts(3, contact_count)
    mu = torch.tensor([0.4, 0.5, 0.6], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(layer, (points, normals, mu))


def test_it_solves_eq_4():
    points, normals = contacts(40, seed=3)
    unit = torch.nn.functional.normalize(normals.detach(), dim=-1)
    forces, residual = wrench_layer(points, unit, 0.5, regulariser=1e-8)
    for p, n, f, value in zip(*(t.detach().numpy() for t in (points, unit, forces, residual)), strict=True):
        assert value == pytest.approx(
            solve_wrench_qp(p, n, 0.5, length_scale=0.05).residual, rel=1e-4, abs=1e-6
        )
        assert pyramid_violation(f, n, 0.5).max() < 1e-8


def test_bad_input():
    points, normals = contacts(2)
    with refused("shape"):
        wrench_layer(points[0], normals[0], 0.5)
    with refused("finite"):
        wrench_layer(points * float("nan"), normals, 0.5)
