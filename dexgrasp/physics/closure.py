"""Which triples of contacts can be in equilibrium: Eq. 4 in closed form, millions of triples a second.

A triple is **feasible** when the least value of Eq. 4, |sum f|^2 + |sum (p - c) x f / L|^2 with f_min = 1,
pyramid cones (Eq. 2) and c the centroid of the three contacts, is below `TOLERANCE`.

Three forces in equilibrium at points not on a line are internal forces, f_i = sum_j x_ij (p_j - p_i) with
x_ij = x_ji: three numbers (a, b, c) = (x12, x13, x23). The cone of contact 1 restricts (a, b) to a wedge,
that of 2 (a, c), that of 3 (b, c). With a = +-1 the first two are intervals of b and c, and the question is
whether a wedge meets a box: some 150 operations, no iteration. f_min scales away, as every non-zero force
in the cone presses.

The closed form is exact for residual zero. It differs from "below TOLERANCE" only near the edge, so triples
feasible at a friction `BAND` (2 %) larger but not at `mu` go to the QP; so do flat triples, in a band that
widens as 1 / height, and those on a line. The QP's answer carries its own proof where it can: feasible
forces with a small residual, or a wrench that separates.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dexgrasp.physics.active_set import SOLVED, solve_qp
from dexgrasp.physics.checks import Numbers, check_contacts, check_positive, rms_radius
from dexgrasp.physics.wedges import chord_tables, closed_form, flatness, frames_into
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError

TOLERANCE = 1e-6
BAND = 1.02
FLAT = 0.15
"""Triangles whose height is below this part of their longest side get the wider band."""
LINE = 4e-3
"""Below this part they count as lying on a line and always go to the QP."""
FORCE_BOUND = 1e6
"""The proof that a triple is infeasible is for contact forces up to this many times f_min."""

Triples = NDArray[np.int32]


@njit(cache=True)
def _map_columns(points: Array, frames: Array, scale: float, G: Array) -> None:
    """Write the grasp map (6, 9) of forces in contact frames, about the centroid, torques / scale."""
    center = (points[0] + points[1] + points[2]) / 3.0
    for i in range(3):
        r = (points[i] - center) / scale
        for j in range(3):
            e = frames[i, j]
            for k in range(3):
                G[k, 3 * i + j] = e[k]
                G[3 + k, 3 * i + j] = r[(k + 1) % 3] * e[(k + 2) % 3] - r[(k + 2) % 3] * e[(k + 1) % 3]


@njit(cache=True)
def _separated(G: Array, w: Array, mu: float) -> float:
    """Bound |G f| from below, by w: over the cones with f_min = 1 and no force above FORCE_BOUND."""
    total, size = 0.0, 0.0
    for k in range(6):
        size += w[k] * w[k]
    h = np.zeros(3)
    for i in range(3):
        for j in range(3):
            h[j] = 0.0
            for k in range(6):
                h[j] += G[k, 3 * i + j] * w[k]
        least = h[0] - mu * (abs(h[1]) + abs(h[2]))
        total += least if least >= 0.0 else least * FORCE_BOUND
    return total / size**0.5 if size > 0.0 else 0.0


@njit(cache=True)
def _restore(f: Array, mu: float) -> None:
    """Move the forces (9,) that rounding left outside the cones back onto them."""
    for i in range(3):
        need = max(1.0, max(abs(f[3 * i + 1]), abs(f[3 * i + 2])) / mu)
        f[3 * i] = max(f[3 * i], need)


@njit(cache=True)
def _qp_feasible(points: Array, frames: Array, mu: float, scale: float) -> bool:
    """Whether Eq. 4's least value (f_min = 1) is below TOLERANCE, by proximal steps of a QP.

    Args:
        points: (3, 3). frames: (3, 3, 3), rows (-n, t1, t2) of each contact.
        mu: friction coefficient. scale: length that divides torques.
    """
    G = np.empty((6, 9))
    _map_columns(points, frames, scale, G)
    A, b = np.zeros((15, 9)), np.zeros(15)
    for i in range(3):
        A[5 * i, 3 * i], b[5 * i] = 1.0, 1.0
        for j in range(4):
            A[5 * i + 1 + j, 3 * i] = mu
            A[5 * i + 1 + j, 3 * i + 1 + j // 2] = 1.0 - 2.0 * (j % 2)
    H, g, f, w = np.zeros((9, 9)), np.zeros(9), np.zeros(9), np.zeros(6)
    reg = 1e-10
    for i in range(9):
        for j in range(9):
            for k in range(6):
                H[i, j] += G[k, i] * G[k, j]
        H[i, i] += reg
    multipliers = np.empty(15)
    least = np.inf
    for _ in range(8):
        if solve_qp(H, g, A, b, f, multipliers) != SOLVED:
            break
        _restore(f, mu)
        value = 0.0
        for k in range(6):
            w[k] = 0.0
            for i in range(9):
                w[k] += G[k, i] * f[i]
            value += w[k] * w[k]
        if value < TOLERANCE:
            return True
        apart = max(0.0, _separated(G, w, mu))
        if apart * apart >= TOLERANCE or value > 0.999 * least:
            break
        least = value
        for i in range(9):
            g[i] = -reg * f[i]
    return False


@njit(cache=True)
def _wider(mu: float, flat2: float) -> float:
    """The friction up to which a triple of this (height / side)^2 may still be feasible within TOLERANCE."""
    if flat2 >= FLAT * FLAT:
        return mu * BAND
    return mu * BAND + 3.0 * TOLERANCE**0.5 / flat2**0.5


class _Cloud(NamedTuple):
    """Points with what is looked up for each pair of them (`chord_tables`)."""

    points: Array  # (n, 3)
    frames: Array  # (n, 3, 3)
    E: Array  # (n, n, 3)
    T: Array  # (n, n, 3)
    D: Array  # (n, n)


@njit(cache=True)
def _sweep_row(i: int, cloud: _Cloud, mu: float, scale: float, near: float, out: NDArray[np.uint8]) -> None:
    """Decide the triples (i, j, k): 0 infeasible, 1 feasible."""
    points, frames, E, T, D = cloud
    n = points.shape[0]
    corners, axes = np.empty((3, 3)), np.empty((3, 3, 3))
    corners[0], axes[0] = points[i], frames[i]
    at = 0
    usual = mu * BAND
    for j in range(i + 1, n):
        if D[i, j] < near:
            at += n - j - 1
            continue
        dij = D[i, j]
        corners[1], axes[1] = points[j], frames[j]
        for k in range(j + 1, n):
            dik, djk = D[i, k], D[j, k]
            if dik < near or djk < near:
                at += 1
                continue
            flat2 = flatness(dij, dik, djk)
            line = flat2 < LINE * LINE
            if not line:
                high = usual if flat2 >= FLAT * FLAT else _wider(mu, flat2)
                if not closed_form(high, E, T, i, j, k):
                    at += 1
                    continue
                if closed_form(mu, E, T, i, j, k):
                    out[at] = 1
                    at += 1
                    continue
            corners[2], axes[2] = points[k], frames[k]
            out[at] = _qp_feasible(corners, axes, mu, scale)
            at += 1


@njit(cache=True)
def _row_start(i: int, n: int) -> int:
    """How many triples (i', j, k) have i' < i."""
    m = n - i
    return n * (n - 1) * (n - 2) // 6 - m * (m - 1) * (m - 2) // 6


@njit(cache=True)
def _sweep(cloud: _Cloud, mu: float, scale: float, near: float, out: NDArray[np.uint8]) -> None:
    n = cloud.points.shape[0]
    for i in range(n - 2):
        _sweep_row(i, cloud, mu, scale, near, out[_row_start(i, n) : _row_start(i + 1, n)])


@njit(cache=True)
def _collect(out: NDArray[np.uint8], n: int, count: int) -> Triples:
    triples = np.empty((count, 3), np.int32)
    at = m = 0
    for i in range(n):
        for j in range(i + 1, n):
            for k in range(j + 1, n):
                if out[at]:
                    triples[m, 0], triples[m, 1], triples[m, 2] = i, j, k
                    m += 1
                at += 1
    return triples


def closure_sweep(
    points: Numbers,
    normals: Numbers,
    mu: float,
    min_distance: float = 0.03,
    length_scale: float | None = None,
) -> Triples:
    """Return every feasible triple of contact points (the module's text says what feasible means).

    Args:
        points: (n, 3) metres.
        normals: (n, 3) unit, out of the object.
        mu: friction coefficient of Eq. 2's pyramid.
        min_distance: triples with two points nearer than this [m] are left out.
        length_scale: divides torques [m]; None is the rms radius of all points about their centroid.

    Returns:
        (M, 3) int32 indices, i < j < k, in lexicographic order.
    """
    points, normals = check_contacts(points, normals)
    mu, n = check_positive("mu", mu), len(points)
    if n > 2048:
        raise InputError(f"a sweep takes at most 2048 points, got {n}")
    if not (np.isfinite(min_distance) and min_distance >= 0):
        raise InputError(f"min_distance must be a finite number of metres >= 0, got {min_distance!r}")
    if n < 3:
        return np.empty((0, 3), np.int32)
    scale = rms_radius(points) if length_scale is None else check_positive("length_scale", length_scale)
    cloud = _Cloud(points, np.empty((n, 3, 3)), np.zeros((n, n, 3)), np.zeros((n, n, 3)), np.zeros((n, n)))
    frames_into(normals, cloud.frames)
    chord_tables(*cloud)
    out = np.zeros(n * (n - 1) * (n - 2) // 6, np.uint8)
    _sweep(cloud, mu, scale, min_distance**2, out)
    return _collect(out, n, int(out.sum()))
