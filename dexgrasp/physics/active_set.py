"""Small dense quadratic programmes in numba: the dual active-set method of Goldfarb and Idnani (1983)."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array

SOLVED, INFEASIBLE, LIMIT = 0, 1, 2


@njit(cache=True)
def _inverse_transpose_factor(H: Array, J: Array) -> bool:
    """Write J = L^-T with H = L L^T; False where H is not positive definite."""
    n = H.shape[0]
    L = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            s = H[i, j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            if i == j:
                if s <= 0.0:
                    return False
                L[i, i] = s**0.5
            else:
                L[i, j] = s / L[j, j]
    for c in range(n):
        for i in range(n):
            J[c, i] = 0.0
        J[c, c] = 1.0 / L[c, c]
        for i in range(c + 1, n):
            s = 0.0
            for k in range(c, i):
                s -= L[i, k] * J[c, k]
            J[c, i] = s / L[i, i]
    return True


@njit(cache=True)
def _rotate_columns(J: Array, i: int, j: int, c: float, s: float) -> None:
    for k in range(J.shape[0]):
        a, b = J[k, i], J[k, j]
        J[k, i] = c * a + s * b
        J[k, j] = c * b - s * a


@njit(cache=True)
def _add(J: Array, R: Array, d: Array, q: int) -> None:
    """Turn the free columns of J so that d has one entry past q, and append it to R."""
    for j in range(d.shape[0] - 1, q, -1):
        h = np.hypot(d[j - 1], d[j])
        if h == 0.0:
            continue
        c, s = d[j - 1] / h, d[j] / h
        d[j - 1], d[j] = h, 0.0
        _rotate_columns(J, j - 1, j, c, s)
    for i in range(q + 1):
        R[i, q] = d[i]


@njit(cache=True)
def _drop(J: Array, R: Array, active: NDArray[np.int64], u: Array, q: int, at: int) -> None:
    """Take the active constraint `at` out; the entry q (the one being added) moves down with the rest."""
    for j in range(at, q - 1):
        active[j] = active[j + 1]
        u[j] = u[j + 1]
        for i in range(j + 2):
            R[i, j] = R[i, j + 1]
    u[q - 1] = u[q]
    for j in range(at, q - 1):
        h = np.hypot(R[j, j], R[j + 1, j])
        if h == 0.0:
            continue
        c, s = R[j, j] / h, R[j + 1, j] / h
        for k in range(j, q - 1):
            a, b = R[j, k], R[j + 1, k]
            R[j, k] = c * a + s * b
            R[j + 1, k] = c * b - s * a
        _rotate_columns(J, j, j + 1, c, s)


@njit(cache=True, inline="always")
def _turned(J: Array, a: Array, d: Array) -> float:
    """Write d = J^T a; return its squared length."""
    size = 0.0
    for i in range(d.shape[0]):
        s = 0.0
        for k in range(d.shape[0]):
            s += J[k, i] * a[k]
        d[i] = s
        size += s * s
    return size


@njit(cache=True, inline="always")
def _move(J: Array, d: Array, q: int, step: float, x: Array) -> None:
    """Add `step` times the columns of J from q on, weighed by d, to x."""
    for k in range(x.shape[0]):
        s = 0.0
        for i in range(q, x.shape[0]):
            s += J[k, i] * d[i]
        x[k] += step * s


@njit(cache=True, inline="always")
def _most_violated(A: Array, b: Array, x: Array, is_active: NDArray[np.bool_]) -> tuple[int, float]:
    """Return the constraint that is violated most and by how much (negative); -1 where none is."""
    worst, p = 0.0, -1
    for k in range(A.shape[0]):
        if is_active[k]:
            continue
        s, scale = -b[k], abs(b[k])
        for i in range(A.shape[1]):
            s += A[k, i] * x[i]
            scale += abs(A[k, i] * x[i])
        if s < -1e-13 * scale - 1e-15 and s < worst:
            worst, p = s, k
    return p, worst


@njit(cache=True)
def solve_qp(H: Array, g: Array, A: Array, b: Array, x: Array, multipliers: Array) -> int:
    """Minimise 0.5 x^T H x + g^T x subject to A x >= b; H positive definite.

    Args:
        H: (n, n). g: (n,). A: (m, n), no zero rows. b: (m,).
        x: (n,), written. multipliers: (m,), written, >= 0.

    Returns:
        SOLVED, INFEASIBLE (or H not positive definite) or LIMIT (iterations).
    """
    n, m = A.shape[1], A.shape[0]
    J, R = np.empty((n, n)), np.zeros((n, n))
    multipliers[:] = 0.0
    if not _inverse_transpose_factor(H, J):
        return INFEASIBLE
    d, r, u = np.empty(n), np.empty(n), np.zeros(n + 1)
    active = np.empty(n, np.int64)
    is_active = np.zeros(m, np.bool_)
    x[:] = 0.0
    _turned(J, g, d)
    _move(J, d, 0, -1.0, x)
    q = 0
    for _ in range(20 * (n + m)):
        p, slack = _most_violated(A, b, x, is_active)
        if p < 0:
            for j in range(q):
                multipliers[active[j]] = u[j]
            return SOLVED
        u[q] = 0.0
        while True:
            size = _turned(J, A[p], d)
            free = 0.0
            for i in range(q, n):
                free += d[i] * d[i]
            for i in range(q - 1, -1, -1):
                s = d[i]
                for j in range(i + 1, q):
                    s -= R[i, j] * r[j]
                r[i] = s / R[i, i]
            t, out = np.inf, -1
            for j in range(q):
                if r[j] > 0.0 and u[j] / r[j] < t:
                    t, out = u[j] / r[j], j
            full = np.inf
            if free > 1e-13 and free > 1e-28 * size:
                full = -slack / free
            if out < 0 and full == np.inf:
                return INFEASIBLE
            step = min(t, full)
            for j in range(q):
                u[j] -= step * r[j]
            u[q] += step
            if full < np.inf:
                _move(J, d, q, step, x)
                slack += step * free
            if full <= t:
                _add(J, R, d, q)
                active[q] = p
                is_active[p] = True
                q += 1
                break
            is_active[active[out]] = False
            _drop(J, R, active, u, q, out)
            q -= 1
    return LIMIT
