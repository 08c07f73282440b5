"""Eq. 4: the wrench that contact forces cannot balance, as a QP, for any number of contacts.

    minimise |sum f_i|^2 + |sum (p_i - c) x f_i / L|^2   subject to   -f_i.n_i >= f_min, |f_i.t_ij| <= -mu f_i.n_i

The paper adds N^2 and (Nm)^2; here torques are divided by a length L, stated by the caller or the contacts'
rms radius, and taken about c, the contacts' centroid. A zero residual depends on neither.

What is left unbalanced of the contacts' effort, in percent, by our own definitions, as the paper does not give its own:
force ratio = |sum f_i| / sum |f_i|, torque ratio = |sum (p_i - c) x f_i| / sum |(p_i - c) x f_i|, c the object's
centroid; 0 for closure.
"""

from typing import NamedTuple

import numpy as np

from dexgrasp.mechanics.cones import tangent_basis
from dexgrasp.mechanics.equilibrium import grasp_map, rms_radius
from dexgrasp_env.arrays import Array
from dexgrasp_env.extras import from_extra

with from_extra():
    import daqp


class WrenchSolution(NamedTuple):
    """Solution of Eq. 4."""

    residual: float
    """The least |F|^2 + |tau / L|^2 [N^2]; of `forces`, which satisfy the constraints exactly."""
    forces: Array
    """(N, 3) contact forces on the object [N]."""


def pyramid_rows(normals: Array, mu: float, f_min: float) -> tuple[Array, Array]:
    """Return A (5 N, 3 N) and b (5 N,) of Eq. 2 and f_min as A f >= b; per contact: press, +t1, -t1, +t2,
    -t2.
    """
    (t1, t2), N, n = tangent_basis(normals), len(normals), mu * normals
    A = np.zeros((N, 5, N, 3))
    A[range(N), :, range(N)] = np.stack([-normals, t1 - n, -t1 - n, t2 - n, -t2 - n], axis=1)
    return A.reshape(5 * N, 3 * N), np.tile([f_min, 0.0, 0.0, 0.0, 0.0], N)


def restore_feasible(forces: Array, normals: Array, mu: float, f_min: float) -> Array:
    """Return forces (N, 3) pressed harder by what rounding left them outside Eq. 2 and f_min."""
    t1, t2 = tangent_basis(normals)
    press = -(forces * normals).sum(-1)
    friction = np.maximum(np.abs((forces * t1).sum(-1)), np.abs((forces * t2).sum(-1)))
    need = np.maximum(f_min, friction / mu * (1 + 1e-15))
    return forces - np.maximum(0.0, need - press)[:, None] * normals


def solve_wrench_qp(
    points: Array,
    normals: Array,
    mu: float,
    f_min: float = 1.0,
    length_scale: float | None = None,
) -> WrenchSolution:
    """Solve Eq. 4 by daqp.

    Args:
        points: (N, 3) metres, one at least.
        normals: (N, 3) unit, out of the object.
        mu: friction coefficient.
        f_min: least pressing force [N] of each contact.
        length_scale: divides torques [m]; None is the contacts' rms radius.
    """
    G = grasp_map(points, points.mean(0), rms_radius(points) if length_scale is None else length_scale)
    A, b = pyramid_rows(normals, mu, f_min)
    # Added to the Hessian for the QP solver, which wants one; the residual returned is computed without it.
    H = G.T @ G + 1e-9 * np.eye(G.shape[1])
    below, sense = np.full(len(b), -1e30), np.zeros(len(b), np.int32)
    x, _, flag, _ = daqp.solve(H, np.zeros(len(H)), -A, -b, below, sense)
    forces = restore_feasible(x.reshape(-1, 3) if flag > 0 else -f_min * normals, normals, mu, f_min)
    wrench = G @ forces.ravel()
    return WrenchSolution(float(wrench @ wrench), forces)


def _ratio(vectors: Array) -> float:
    total = np.sqrt((vectors**2).sum(-1)).sum()
    return float(100.0 * np.sqrt((vectors.sum(0) ** 2).sum()) / total) if total > 0 else 0.0


def wrench_ratios(points: Array, forces: Array, centroid: Array) -> tuple[float, float]:
    """Return force and torque ratio [%] of forces (N, 3) at points (N, 3); `centroid` (3,) of the object."""
    return _ratio(forces), _ratio(np.cross(points - centroid, forces))
