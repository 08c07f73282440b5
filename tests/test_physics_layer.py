import numpy as np
import pytest

torch = pytest.importorskip("torch")

from agents.physics.cones import pyramid_violation, tangent_basis  # noqa: E402
from agents.physics.layer import tangent_basis as torch_basis  # noqa: E402
from agents.physics.layer import wrench_layer  # noqa: E402
from agents.physics.wrench import residual_gradient  # noqa: E402
from dexgrasp_env.errors import InputError  # noqa: E402


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


def test_basis_is_that_of_the_package():
    normals = torch.nn.functional.normalize(contacts(1, 50)[1].detach()[0], dim=-1)
    for ours, theirs in zip(torch_basis(normals), tangent_basis(normals.numpy()), strict=True):
        np.testing.assert_allclose(ours.numpy(), theirs, atol=1e-12)


def test_gradient_of_the_value_is_the_envelope_theorem():
    points, normals = contacts(1, seed=3)
    unit = torch.nn.functional.normalize(normals.detach(), dim=-1)
    forces, residual = wrench_layer(
        points, unit, 0.5, length_scale=0.05, center=torch.zeros(3), regulariser=1e-4
    )
    value = residual.sum() + 1e-4 * (forces**2).sum()
    (gradient,) = torch.autograd.grad(value, points)
    setting = {"length_scale": 0.05, "center": np.zeros(3), "regulariser": 1e-4}
    expected, dp, _ = residual_gradient(points.detach().numpy()[0], unit.numpy()[0], 0.5, **setting)
    assert value.item() == pytest.approx(expected, rel=1e-9)
    np.testing.assert_allclose(gradient[0].numpy(), dp, rtol=1e-6, atol=1e-6)
    assert pyramid_violation(forces.detach().numpy()[0], unit.numpy()[0], 0.5).max() < 1e-8


def test_second_derivatives_are_refused():
    points, normals = contacts(2)
    (gradient,) = torch.autograd.grad(layer(points, normals, 0.5)[1].sum(), points, create_graph=True)
    with pytest.raises(RuntimeError, match="twice"):
        gradient.sum().backward()


def test_bad_input():
    points, normals = contacts(2)
    with pytest.raises(InputError, match="shape"):
        wrench_layer(points[0], normals[0], 0.5)
    with pytest.raises(InputError, match="finite"):
        wrench_layer(points * float("nan"), normals, 0.5)
