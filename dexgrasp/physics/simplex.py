"""Linear programmes in four variables with many rows: the dual simplex method, compiled."""

import numpy as np
from numba import njit

from dexgrasp_env.arrays import Array

SIZE = 4
_FAR = 1e4  # half side of the box in which the answer is looked for
_PIVOTS = 200
_VIOLATED = 1e-9


@njit(cache=True, error_model="numpy")
def maximise_last(A: Array, b: Array, rows: int, most: float, z: Array) -> bool:
    """Maximise z[3] <= most subject to A z >= b; False where nothing satisfies that, or no end is found.

    The corner of a large box is optimal until rows are asked for; the most violated row enters, until none is.

    Args:
        A: (at least `rows`, 4). b: of `rows` entries.
        rows: how many count.
        most: bound of z[3]; the other variables lie within 1e4.
        z: (4,), written.
    """
    # The basis holds four rows a_k with right-hand sides v; inverse is that of the matrix that has them as rows.
    inverse, v, share, w = -np.eye(SIZE), np.full(SIZE, -_FAR), np.zeros(SIZE), np.empty(SIZE)
    v[SIZE - 1], share[SIZE - 1] = -most, 1.0
    for _ in range(_PIVOTS):
        for i in range(SIZE):
            z[i] = 0.0
            for k in range(SIZE):
                z[i] += inverse[i, k] * v[k]
        worst, enter = -_VIOLATED, -1
        for r in range(rows):
            slack = A[r, 0] * z[0] + A[r, 1] * z[1] + A[r, 2] * z[2] + A[r, 3] * z[3] - b[r]
            if slack < worst:
                worst, enter = slack, r
        if enter < 0:
            return True
        leave, least = -1, np.inf
        for k in range(SIZE):
            w[k] = 0.0
            for i in range(SIZE):
                w[k] += A[enter, i] * inverse[i, k]
            if w[k] > 1e-10:
                ratio = max(share[k], 0.0) / w[k]
                if ratio < least or (ratio == least and w[k] > w[leave]):
                    leave, least = k, ratio
        if leave < 0:
            return False
        for k in range(SIZE):
            share[k] = least if k == leave else share[k] - least * w[k]
        for i in range(SIZE):
            inverse[i, leave] /= w[leave]
            for k in range(SIZE):
                if k != leave:
                    inverse[i, k] -= w[k] * inverse[i, leave]
        v[leave] = b[enter]
    return False
