"""Friction cones: the exact one (Eq. 1), the one with four faces (Eq. 2), and their tangent basis.

Normals `n` point out of the object, forces `f` act on it, so `-f.n` is the pressing force.

The tangent basis is the frame `(C1, C2, C)` turned by the smallest rotation that takes `C` to `n`. It is
smooth in `n` everywhere but at `n = -C`, where a fixed basis is returned. Duff et al. (2017) jump across
`n_z = 0`, and (-n_y, n_x, 0) is singular at +-z: both are the normals that boxes and cans have. `C` is
therefore (1, 2, 3) / |.|, away from all of them.
"""

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import leaf

_S14, _S10, _S140 = 14.0**0.5, 10.0**0.5, 140.0**0.5
C = (1.0 / _S14, 2.0 / _S14, 3.0 / _S14)
C1 = (3.0 / _S10, 0.0, -1.0 / _S10)
C2 = (-2.0 / _S140, 10.0 / _S140, -6.0 / _S140)
POLE = 1e-12
"""Normals with 1 + C.n below this get the basis (C1, -C2)."""


@leaf
def basis_of(x: float, y: float, z: float) -> tuple[float, float, float, float, float, float]:
    """Return the tangents (t1, t2) of the unit normal (x, y, z), as scalars: hot loops allocate nothing."""
    D = 1.0 + C[0] * x + C[1] * y + C[2] * z
    if D < POLE:
        return C1[0], C1[1], C1[2], -C2[0], -C2[1], -C2[2]
    a = (C1[0] * x + C1[1] * y + C1[2] * z) / D
    b = (C2[0] * x + C2[1] * y + C2[2] * z) / D
    hx, hy, hz = C[0] + x, C[1] + y, C[2] + z
    return C1[0] - a * hx, C1[1] - a * hy, C1[2] - a * hz, C2[0] - b * hx, C2[1] - b * hy, C2[2] - b * hz


def tangent_basis(normals: Array) -> tuple[Array, Array]:
    """Return the tangents t1, t2 (N, 3) of unit normals (N, 3); see the module's text for the choice."""
    bases = np.array([basis_of(*normal) for normal in normals]).reshape(-1, 2, 3)
    return bases[:, 0], bases[:, 1]


def cone_edges(normals: Array, mu: float, edges: int) -> Array:
    """Return the edges (N, edges, 3) of pyramids inside the exact cones, each with a pressing force of 1.

    Args:
        normals: (N, 3) unit normals.
        mu: friction coefficient.
        edges: how many, at least 3; the first lies along t1.
    """
    t1, t2 = tangent_basis(normals)
    angle = 2.0 * np.pi * np.arange(edges) / edges
    u, v = mu * np.cos(angle)[:, None], mu * np.sin(angle)[:, None]
    return -normals[:, None] + u * t1[:, None] + v * t2[:, None]
