"""Friction cones: the exact one (Eq. 1), the one with four faces (Eq. 2), and their tangent basis.

Normals `n` point out of the object, forces `f` act on it, so `-f.n` is the pressing force.

The tangent basis is the frame `(C1, C2, C)` turned by the smallest rotation that takes `C` to `n`. It is
smooth in `n` everywhere but at `n = -C`, where a fixed basis is returned. Duff et al. (2017) jump across
`n_z = 0`, and (-n_y, n_x, 0) is singular at +-z: both are the normals that boxes and cans have. `C` is
therefore (1, 2, 3) / |.|, away from all of them.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from agents.physics.checks import Numbers, check_array, check_positive, check_unit
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError

_S14, _S10, _S140 = 14.0**0.5, 10.0**0.5, 140.0**0.5
C = (1.0 / _S14, 2.0 / _S14, 3.0 / _S14)
C1 = (3.0 / _S10, 0.0, -1.0 / _S10)
C2 = (-2.0 / _S140, 10.0 / _S140, -6.0 / _S140)
POLE = 1e-12
"""Normals with 1 + C.n below this get the basis (C1, -C2)."""


@njit(cache=True)
def basis_of(x: float, y: float, z: float) -> tuple[float, float, float, float, float, float]:
    """Return the tangents (t1, t2) of the unit normal (x, y, z), as scalars: hot loops allocate nothing."""
    D = 1.0 + C[0] * x + C[1] * y + C[2] * z
    if D < POLE:
        return C1[0], C1[1], C1[2], -C2[0], -C2[1], -C2[2]
    a = (C1[0] * x + C1[1] * y + C1[2] * z) / D
    b = (C2[0] * x + C2[1] * y + C2[2] * z) / D
    hx, hy, hz = C[0] + x, C[1] + y, C[2] + z
    return C1[0] - a * hx, C1[1] - a * hy, C1[2] - a * hz, C2[0] - b * hx, C2[1] - b * hy, C2[2] - b * hz


@njit(cache=True)
def basis_into(n: Array, t1: Array, t2: Array) -> None:
    """Write the tangent basis of one unit normal (3,): (t1, t2, n) is right-handed."""
    t1[0], t1[1], t1[2], t2[0], t2[1], t2[2] = basis_of(n[0], n[1], n[2])


@njit(cache=True)
def basis_pullback(n: Array, g1: Array, g2: Array, out: Array) -> None:
    """Add (dt1/dn)^T g1 + (dt2/dn)^T g2 to `out` (3,): the derivative of the basis as the normal turns.

    The formulas of `basis_into` are differentiated as they stand, so only the part of `out` tangent to the
    sphere
    is meaningful. At the pole the derivative does not exist and nothing is added.
    """
    D = 1.0 + C[0] * n[0] + C[1] * n[1] + C[2] * n[2]
    if D < POLE:
        return
    e1 = e2 = s1 = s2 = 0.0
    for k in range(3):
        e1 += C1[k] * n[k]
        e2 += C2[k] * n[k]
        s1 += g1[k] * (C[k] + n[k])
        s2 += g2[k] * (C[k] + n[k])
    for k in range(3):
        out[k] -= s1 * (C1[k] - e1 * C[k] / D) / D + e1 / D * g1[k]
        out[k] -= s2 * (C2[k] - e2 * C[k] / D) / D + e2 / D * g2[k]


@njit(cache=True)
def _bases(normals: Array, t1: Array, t2: Array) -> None:
    for i in range(normals.shape[0]):
        basis_into(normals[i], t1[i], t2[i])


def tangent_basis(normals: Numbers) -> tuple[Array, Array]:
    """Return the tangents t1, t2 (N, 3) of unit normals (N, 3); see the module's text for the choice."""
    normals = check_array("normals", normals, (None, 3))
    check_unit(normals)
    t1, t2 = np.empty_like(normals), np.empty_like(normals)
    _bases(normals, t1, t2)
    return t1, t2


def contact_components(forces: Array, normals: Array) -> tuple[Array, Array, Array]:
    """Return (-f.n, f.t1, f.t2), each (N,), of forces (N, 3)."""
    t1, t2 = tangent_basis(normals)
    return -(forces * normals).sum(-1), (forces * t1).sum(-1), (forces * t2).sum(-1)


def project_to_cone(forces: Numbers, normals: Numbers, mu: float) -> Array:
    """Return the nearest forces (N, 3) in the exact cones (Eq. 1)."""
    forces = check_array("forces", forces, (None, 3))
    normals = check_array("normals", normals, (len(forces), 3))
    mu = check_positive("mu", mu)
    press = -(forces * normals).sum(-1, keepdims=True)
    tangent = forces + press * normals
    size = np.sqrt((tangent**2).sum(-1, keepdims=True))
    along = np.maximum(0.0, (press + mu * size) / (1.0 + mu * mu))
    direction = np.divide(tangent, size, out=np.zeros_like(tangent), where=size > 0)
    onto = along * (mu * direction - normals)
    return np.where(size <= mu * press, forces, np.where(mu * size <= -press, 0.0, onto))


def cone_distance(forces: Numbers, normals: Numbers, mu: float) -> Array:
    """Return the distances [N] (N,) of forces (N, 3) from the exact cones: 0 inside."""
    nearest = project_to_cone(forces, normals, mu)
    return np.sqrt(((np.asarray(forces, dtype=float) - nearest) ** 2).sum(-1))


def in_cone(forces: Numbers, normals: Numbers, mu: float, tolerance: float = 1e-9) -> NDArray[np.bool_]:
    """Say which forces (N, 3) lie in their exact cone (Eq. 1), within `tolerance` [N]."""
    return cone_distance(forces, normals, mu) <= tolerance


def pyramid_violation(forces: Numbers, normals: Numbers, mu: float) -> Array:
    """Return by how much [N] forces (N, 3) break Eq. 2: max(-press, |f.t_j| - mu press); <= 0 inside."""
    forces = check_array("forces", forces, (None, 3))
    press, u, v = contact_components(forces, check_array("normals", normals, (len(forces), 3)))
    return np.maximum(-press, np.maximum(np.abs(u), np.abs(v)) - check_positive("mu", mu) * press)


def cone_edges(normals: Numbers, mu: float, edges: int = 4, eq2: bool = False) -> Array:
    """Return the edges (N, edges, 3) of pyramids, each with a pressing force of 1.

    Args:
        normals: (N, 3) unit normals.
        mu: friction coefficient.
        edges: how many, at least 3. The first lies along t1: the pyramid is inscribed in the exact cone.
        eq2: the four corners of Eq. 2 instead, friction sqrt(2) mu; `edges` must be 4.
    """
    if edges < 3 or (eq2 and edges != 4):
        raise InputError(f"edges must be at least 3 (exactly 4 with eq2), got {edges}")
    t1, t2 = tangent_basis(normals)
    angle = 2.0 * np.pi * np.arange(edges) / edges + (np.pi / 4 if eq2 else 0.0)
    radius = check_positive("mu", mu) * (2.0**0.5 if eq2 else 1.0)
    u, v = radius * np.cos(angle)[:, None], radius * np.sin(angle)[:, None]
    return -np.asarray(normals, dtype=float)[:, None] + u * t1[:, None] + v * t2[:, None]
