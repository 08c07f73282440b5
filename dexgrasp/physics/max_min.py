"""The largest least value of affine functions of the plane: a linear programme in three variables, compiled."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array


@njit(cache=True)
def _basis_weights(s: Array, B: NDArray[np.int64], w: Array, b0: float, b1: float, b2: float) -> bool:
    """Solve sum_k w_k (s0, s1, 1)_Bk = (b0, b1, b2); False where the three rows are dependent."""
    a0, a1 = s[B[0], 0], s[B[0], 1]
    x1, y1, x2, y2 = s[B[1], 0] - a0, s[B[1], 1] - a1, s[B[2], 0] - a0, s[B[2], 1] - a1
    D = x1 * y2 - x2 * y1
    if abs(D) < 1e-300:
        return False
    rx, ry = b0 - b2 * a0, b1 - b2 * a1
    w[1] = (rx * y2 - x2 * ry) / D
    w[2] = (x1 * ry - rx * y1) / D
    w[0] = b2 - w[1] - w[2]
    return True


@njit(cache=True)
def _plane_max(s: Array, d: Array, B: NDArray[np.int64], y: Array) -> bool:
    """Write y, t with d_k + s_k . y = t for the three rows of the basis."""
    x1, y1 = s[B[1], 0] - s[B[0], 0], s[B[1], 1] - s[B[0], 1]
    x2, y2 = s[B[2], 0] - s[B[0], 0], s[B[2], 1] - s[B[0], 1]
    D = x1 * y2 - x2 * y1
    if abs(D) < 1e-300:
        return False
    r1, r2 = d[B[0]] - d[B[1]], d[B[0]] - d[B[2]]
    y[0] = (r1 * y2 - y1 * r2) / D
    y[1] = (x1 * r2 - x2 * r1) / D
    y[2] = d[B[0]] + s[B[0], 0] * y[0] + s[B[0], 1] * y[1]
    return True


@njit(cache=True)
def max_min(s: Array, d: Array, m: int, B: NDArray[np.int64], y: Array, lam: Array) -> bool:
    """Maximise over y in the plane the least of d_k + s_k . y, k < m, by the simplex method on its dual.

    `B` (3,) is a basis to start from (its weights must be >= 0), and the optimal one on return; `y` (3,) is
    written with the maximiser and the value, `lam` (3,) with the dual weights of `B`.
    """
    w = np.empty(3)
    for step in range(400):
        if not _plane_max(s, d, B, y) or not _basis_weights(s, B, lam, 0.0, 0.0, 1.0):
            return False
        worst, enter = -1e-12 * (1.0 + abs(y[2])), -1
        for k in range(m):
            slack = d[k] + s[k, 0] * y[0] + s[k, 1] * y[1] - y[2]
            if slack < worst - 1e-13 * abs(d[k]):
                enter = k
                if step > 60:  # Bland's rule ends cycles
                    break
                worst = slack
        if enter < 0 or enter == B[0] or enter == B[1] or enter == B[2]:
            return True
        _basis_weights(s, B, w, s[enter, 0], s[enter, 1], 1.0)
        least, leave = np.inf, -1
        for k in range(3):
            if w[k] > 1e-14 and max(lam[k], 0.0) / w[k] < least:
                least, leave = max(lam[k], 0.0) / w[k], k
        if leave < 0:
            return True
        B[leave] = enter
    return True


@njit(cache=True)
def start_rows(s: Array, d: Array, m: int, B: NDArray[np.int64]) -> None:
    """Append three artificial rows around the origin, so high that only an unbounded maximum keeps them."""
    size = 0.0
    for k in range(m):
        size = max(size, abs(s[k, 0]) + abs(s[k, 1]) + abs(d[k]))
    high = 1e7 * (1.0 + size)
    for k in range(3):
        d[m + k] = high
        B[k] = m + k
    s[m, 0], s[m, 1] = 1.0, 0.0
    s[m + 1, 0], s[m + 1, 1] = -0.5, 0.8660254037844386
    s[m + 2, 0], s[m + 2, 1] = -0.5, -0.8660254037844386
