"""Linear programmes of a few unknowns and many rows, with multipliers: the dual simplex method, compiled.

Maximise the last of the unknowns z subject to A z >= b. The corner of a large box is optimal until rows are asked for;
the most violated row enters the basis, until none is. Rows may be added to a programme that has been solved: it goes on
from where it is, which is what cutting planes ask for.
"""

from typing import NamedTuple

import numpy as np

from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.compiled import leaf, njit

FAR = 1e4
"""Bound of the unknowns but the last."""


class Simplex(NamedTuple):
    """A programme of n unknowns, and where its solution stands."""

    z: Array  # (n,) the unknowns
    A: Array  # (rows at most, n)
    b: Array  # (rows at most,)
    size: Index  # (1,) how many rows there are
    basis: Index  # (n,) the rows that hold with equality, -1 for the box
    multipliers: Array  # (n,) of those rows, >= 0
    inverse: Array  # (n, n) of the matrix that has them as rows
    right: Array  # (n,) their right-hand sides
    entering: Array  # (n,) the row that enters, in the basis


@njit
def empty_simplex(n: int, rows: int) -> Simplex:
    """Return room for a programme of n unknowns and at most so many rows."""
    return Simplex(
        np.zeros(n), np.empty((rows, n)), np.empty(rows), np.zeros(1, np.int64), np.empty(n, np.int64), np.empty(n),
        np.empty((n, n)), np.empty(n), np.empty(n),
    )  # fmt: skip


@leaf
def restart(lp: Simplex, most: float) -> None:
    """Forget all rows; the last unknown is at most `most`."""
    n = len(lp.z)
    for i in range(n):
        for k in range(n):
            lp.inverse[i, k] = 0.0
        lp.inverse[i, i], lp.right[i], lp.multipliers[i], lp.basis[i] = -1.0, -FAR, 0.0, -1
    lp.right[n - 1], lp.multipliers[n - 1], lp.size[0] = -most, 1.0, 0


@leaf
def solve(lp: Simplex, tolerance: float) -> bool:
    """Write unknowns and multipliers; False where nothing satisfies all rows to `tolerance`, or no end is found."""
    n, z, A, b, worst = len(lp.z), lp.z, lp.A, lp.b, 0.0
    for _ in range(200):
        for i in range(n):
            z[i] = 0.0
            for k in range(n):
                z[i] += lp.inverse[i, k] * lp.right[k]
        worst, enter = -tolerance, -1
        for r in range(lp.size[0]):
            slack = -b[r]
            for k in range(n):
                slack += A[r, k] * z[k]
            if slack < worst:
                worst, enter = slack, r
        if enter < 0:
            return True
        leave = _leaving(lp, enter)
        if leave < 0:
            return False
        if lp.basis[leave] == enter:  # what is left is rounding
            return True
        _exchange(lp, leave, enter)
    return worst > -1e-7  # violation that passes where pivots go round in circles at rounding


@leaf
def _leaving(lp: Simplex, enter: int) -> int:
    """Write the row that enters in the basis; return which place it takes, -1 where no multiplier would fall."""
    n, w, leave, least = len(lp.z), lp.entering, -1, np.inf
    for k in range(n):
        w[k] = 0.0
        for i in range(n):
            w[k] += lp.A[enter, i] * lp.inverse[i, k]
        if w[k] > 1e-10:
            ratio = max(lp.multipliers[k], 0.0) / w[k]
            if ratio < least or (ratio == least and w[k] > w[leave]):
                leave, least = k, ratio
    return leave


@leaf
def _exchange(lp: Simplex, leave: int, enter: int) -> None:
    n, w, inverse = len(lp.z), lp.entering, lp.inverse
    step = max(lp.multipliers[leave], 0.0) / w[leave]
    for k in range(n):
        lp.multipliers[k] -= step * w[k]
    lp.multipliers[leave], lp.right[leave], lp.basis[leave] = step, lp.b[enter], enter
    for i in range(n):
        inverse[i, leave] /= w[leave]
        for k in range(n):
            if k != leave:
                inverse[i, k] -= w[k] * inverse[i, leave]
