"""The push that any forces at three contacts could bear: linear programmes in four variables, by cutting planes.

All forces that balance a wrench are one answer and the three internal forces along the sides of the triangle (see
`squeeze`). The largest s with some of them within exact cones and torque limits comes from planes that touch the cones,
added where the answer leaves them.
"""

import numpy as np
from numba import njit

from dexgrasp.physics.cones import basis_of
from dexgrasp.physics.simplex import maximise_last
from dexgrasp.physics.squeeze import balance
from dexgrasp_env.arrays import Array

_FACES, _ROUNDS = 8, 24
_OUT = 1e-7  # of the pressing force: what a force may be outside its cone


@njit(cache=True, error_model="numpy")
def capacity_kernel(
    points: Array, normals: Array, centre: Array, weight: float, mu: float, J: Array, limit: Array,
    directions: Array, stop: float,
) -> float:  # fmt: skip
    """Return 1 + the least push in weights over unit `directions` (K, 3), or the share of gravity below 1; no checks.

    Where it is below `stop`, anything from it up to there may be returned, and the push that says so is put first in
    `directions`: what is too hard for one grasp mostly is for the next like it.

    Args:
        points: (3, 3) m. normals: (3, 3) unit, out of the object. centre: (3,) m, centre of mass.
        weight: N.
        mu: friction coefficient.
        J: (3, 3, joints) of the contact points. limit: (joints,) Nm.
        directions: of the pushes.
        stop: what need not be known exactly.
    """
    N, B, f_g = np.empty((9, 3)), np.empty((9, 3)), np.empty(9)
    gravity = np.array([0.0, 0.0, -weight])
    if not balance(points, centre, gravity, N, B, f_g):
        return 0.0
    share = _most(normals, mu, J, limit, N, np.zeros(9), f_g)
    if share < 1.0:
        return share
    least = np.inf
    for k in range(directions.shape[0]):
        along = -weight * (B @ np.ascontiguousarray(directions[k]))
        least = min(least, _most(normals, mu, J, limit, N, f_g, along))
        if 1.0 + least < stop:
            for c in range(3):
                directions[0, c], directions[k, c] = directions[k, c], directions[0, c]
            break
    return 1.0 + least


@njit(cache=True, error_model="numpy")
def _most(normals: Array, mu: float, J: Array, limit: Array, N: Array, fixed: Array, along: Array) -> float:
    """The largest s for which fixed + s along + N x is within cones and torque limits for some x; 0 if none."""
    size = 3 * _FACES + 6 * J.shape[2] + 3 * _ROUNDS
    A, b, z, T = np.empty((size, 4)), np.empty(size), np.empty(4), np.empty((3, 6))
    a, rows = np.empty(3), 0
    for i in range(3):
        T[i] = basis_of(normals[i, 0], normals[i, 1], normals[i, 2])
        for k in range(_FACES):
            turn = 2.0 * np.pi * k / _FACES
            rows = _cut(i, np.cos(turn), np.sin(turn), mu, normals, T, N, fixed, along, A, b, rows)
        for j in range(J.shape[2]):
            for k in range(3):
                a[k] = J[i, k, j] / limit[j]
            if a[0] == 0.0 and a[1] == 0.0 and a[2] == 0.0:
                continue
            for sign in (1.0, -1.0):
                rows = _row(i, -sign * a, -1.0, N, fixed, along, A, b, rows)
    for _ in range(_ROUNDS):
        if not maximise_last(A, b, rows, 1e6, z):
            return 0.0
        before = rows
        for i in range(3):
            press, u, v = 0.0, 0.0, 0.0
            for k in range(3):
                c = 3 * i + k
                f = fixed[c] + z[3] * along[c] + N[c, 0] * z[0] + N[c, 1] * z[1] + N[c, 2] * z[2]
                press -= f * normals[i, k]
                u += f * T[i, k]
                v += f * T[i, 3 + k]
            size_t = np.sqrt(u * u + v * v)
            if size_t > mu * press + _OUT * abs(press):
                rows = _cut(i, u / size_t, v / size_t, mu, normals, T, N, fixed, along, A, b, rows)
        if rows == before:
            break
    return max(z[3], 0.0)


@njit(cache=True, error_model="numpy")
def _cut(
    i: int, u: float, v: float, mu: float, normals: Array, T: Array, N: Array, fixed: Array, along: Array, A: Array,
    b: Array, rows: int,
) -> int:  # fmt: skip
    """Append the plane that touches cone i where friction points along (u, v); return how many rows there are then."""
    a = np.empty(3)
    for k in range(3):
        a[k] = -mu * normals[i, k] - u * T[i, k] - v * T[i, 3 + k]
    return _row(i, a, 0.0, N, fixed, along, A, b, rows)


@njit(cache=True, error_model="numpy")
def _row(
    i: int, a: Array, bound: float, N: Array, fixed: Array, along: Array, A: Array, b: Array, rows: int
) -> int:
    """Append a . f_i >= bound in the variables (x, s); return how many rows there are then."""
    A[rows] = 0.0
    b[rows] = bound
    for k in range(3):
        c = 3 * i + k
        for q in range(3):
            A[rows, q] += a[k] * N[c, q]
        A[rows, 3] += a[k] * along[c]
        b[rows] -= a[k] * fixed[c]
    return rows + 1
