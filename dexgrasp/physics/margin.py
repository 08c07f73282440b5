"""How far a grasp is from losing force closure, with gradients.

The **margin** is the min-weight metric (Shaw Cortez; FRoGGeR, 2023) taken to the exact cone (Eq. 1). Forces
in equilibrium at three contacts are the internal forces of their triangle (see `closure`); with N_i the
pressing and f_t,i the tangential part of each,

    margin = 3 max over internal forces, with sum N_i = 1, of min_i [N_i - |f_t,i| / mu].

It is at most 1, positive inside closure and negative outside, so it has a slope on both sides of the edge,
and it depends neither on a length scale of torques, nor on their reference point, nor on a tangent basis.
Inscribed pyramids, with |u| + |v| for |f_t|, would give min-weight itself, which is never above it.

It has a plateau: where two contacts alone can hold each other and the third only breaks the balance, the
best is to press with the third not at all, and the value is 0 with a zero gradient (3 to 5 % of random
grasps). Eq. 4's residual has a slope there.

Gradients come from the envelope theorem: the partial derivative of the Lagrangian at the optimum. Those by
normals are tangent to the sphere (the normal stays a unit vector).
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dexgrasp.physics.checks import (
    Numbers,
    check_array,
    check_positive,
    check_unit,
)
from dexgrasp.physics.cones import basis_of
from dexgrasp.physics.max_min import max_min, start_rows
from dexgrasp_env.arrays import Array

UNDEFINED = -1e3
"""Value of triples on a line, and of those whose internal forces cannot press at all; values end there."""
_MAX_ROWS = 160


class Grip(NamedTuple):
    """Three contacts."""

    points: Array  # (3, 3) m
    normals: Array  # (3, 3) unit, out of the object
    mu: float


class Slopes(NamedTuple):
    """Room for gradients of a margin and for the forces at its optimum."""

    by_points: Array  # (3, 3) 1/m
    by_normals: Array  # (3, 3)
    forces: Array  # (3, 3) N


class _Internal(NamedTuple):
    """Internal forces x0 + Q^T y of unit pressing sum, over the chords of the triangle."""

    X: Array  # (3, 3, 3): force at contact i of a unit internal force along chord j
    x0: Array  # (3,)
    Q: Array  # (2, 3)


class _Cuts(NamedTuple):
    """Faces of the cones: row k of contact `owner` bounds N - (u, v) . f_t / mu, in the plane d + s . y."""

    T: Array  # (3, 2, 3) tangents of the contacts
    owner: NDArray[np.int64]  # (_MAX_ROWS,), -1 for the artificial rows
    u: Array  # (_MAX_ROWS,)
    v: Array
    s: Array  # (_MAX_ROWS, 2)
    d: Array  # (_MAX_ROWS,)


class _Optimum(NamedTuple):
    """Where the simplex method ended."""

    y: Array  # (3,): the plane's coordinates and the value
    lam: Array  # (3,) weights of the basis
    B: NDArray[np.int64]  # (3,) rows of the basis


@njit(cache=True)
def _chords(points: Array, X: Array) -> bool:
    """Write X[i, j], the force at contact i of a unit internal force j (12, 13, 23); False on a line."""
    lengths = np.empty(3)
    for j in range(3):
        a, b = (0, 1) if j == 0 else ((0, 2) if j == 1 else (1, 2))
        lengths[j] = 0.0
        for k in range(3):
            lengths[j] += (points[b, k] - points[a, k]) ** 2
        lengths[j] = lengths[j] ** 0.5
        if lengths[j] < 1e-9:
            return False
        for k in range(3):
            e = (points[b, k] - points[a, k]) / lengths[j]
            X[a, j, k], X[b, j, k] = e, -e
    dot = 0.0
    for k in range(3):
        dot += X[0, 0, k] * X[0, 1, k]
    return dot * dot < 1.0 - 1e-12


@njit(cache=True)
def _complete(N: Array, Q: Array) -> bool:
    """Write two unit vectors orthogonal to N (3,) and to each other into Q (2, 3); False where N vanishes."""
    size = (N[0] ** 2 + N[1] ** 2 + N[2] ** 2) ** 0.5
    if size < 1e-7:
        return False
    t = basis_of(N[0] / size, N[1] / size, N[2] / size)
    for k in range(3):
        Q[0, k], Q[1, k] = t[k], t[3 + k]
    return True


@njit(cache=True)
def _cut(grip: Grip, internal: _Internal, cuts: _Cuts, k: int, i: int, u: float, v: float) -> None:
    """Write row k: what contact i presses beyond what friction along (u, v) needs, a function of y."""
    cuts.owner[k], cuts.u[k], cuts.v[k] = i, u, v
    cuts.d[k] = cuts.s[k, 0] = cuts.s[k, 1] = 0.0
    q = np.empty(3)
    for c in range(3):
        q[c] = -grip.normals[i, c] - (u * cuts.T[i, 0, c] + v * cuts.T[i, 1, c]) / grip.mu
    for j in range(3):
        r = 0.0
        for c in range(3):
            r += q[c] * internal.X[i, j, c]
        cuts.d[k] += r * internal.x0[j]
        cuts.s[k, 0] += r * internal.Q[0, j]
        cuts.s[k, 1] += r * internal.Q[1, j]


@njit(cache=True)
def _margin(grip: Grip, slopes: Slopes) -> float:
    """The value of `cone_margin`; writes gradients and the optimal forces."""
    for out in (slopes.by_points, slopes.by_normals, slopes.forces):
        out[:] = 0.0
    cuts = _empty_cuts(grip)
    best = _Optimum(np.empty(3), np.empty(3), np.empty(3, np.int64))
    value = _optimise(grip, cuts, best, slopes.forces, 0.0, -np.inf)
    if value > UNDEFINED:
        _gradients(grip, cuts, best, slopes)
    return value


@njit(cache=True)
def _optimise(
    grip: Grip, cuts: _Cuts, best: _Optimum, forces: Array, tolerance: float, enough: float
) -> float:
    """Return the margin, at most `tolerance` too high, or any bound of it from above that is not above `enough`."""
    internal = _Internal(np.zeros((3, 3, 3)), np.empty(3), np.empty((2, 3)))
    if not _span(grip, internal):
        return UNDEFINED
    m = _first_cuts(grip, internal, cuts)
    start_rows(cuts.s, cuts.d, m, best.B)
    m += 3
    if not max_min(cuts.s, cuts.d, m, best.B, best.y, best.lam):
        return UNDEFINED
    for _ in range(45):
        if 3.0 * best.y[2] <= enough:
            break
        _forces(internal, best.y, forces)
        before = m
        m = _more_cuts(grip, internal, cuts, best.y[2], forces, m, tolerance / 3.0)
        if m == before or not max_min(cuts.s, cuts.d, m, best.B, best.y, best.lam):
            break
    if cuts.owner[best.B].min() < 0 or 3.0 * best.y[2] <= UNDEFINED:
        return UNDEFINED
    return 3.0 * best.y[2]


@njit(cache=True)
def _span(grip: Grip, internal: _Internal) -> bool:
    """Write the internal forces whose pressing parts sum to 1; False where there are none."""
    N = np.zeros(3)
    if not _chords(grip.points, internal.X):
        return False
    for j in range(3):
        for i in range(3):
            for k in range(3):
                N[j] -= grip.normals[i, k] * internal.X[i, j, k]
    if not _complete(N, internal.Q):
        return False
    size = N[0] ** 2 + N[1] ** 2 + N[2] ** 2
    for j in range(3):
        internal.x0[j] = N[j] / size
    return True


@njit(cache=True)
def _empty_cuts(grip: Grip) -> _Cuts:
    T = np.empty((3, 2, 3))
    for i in range(3):
        T[i, 0, 0], T[i, 0, 1], T[i, 0, 2], T[i, 1, 0], T[i, 1, 1], T[i, 1, 2] = basis_of(
            grip.normals[i, 0], grip.normals[i, 1], grip.normals[i, 2]
        )
    owner, u, v = np.full(_MAX_ROWS, -1), np.zeros(_MAX_ROWS), np.zeros(_MAX_ROWS)
    return _Cuts(T, owner, u, v, np.empty((_MAX_ROWS, 2)), np.empty(_MAX_ROWS))


@njit(cache=True)
def _first_cuts(grip: Grip, internal: _Internal, cuts: _Cuts) -> int:
    """Write four rows a contact; return how many in all."""
    for i in range(3):
        for face in range(4):
            u, v = (1.0 - 2.0 * (face % 2)) * 0.5**0.5, (1.0 - 2.0 * (face // 2)) * 0.5**0.5
            _cut(grip, internal, cuts, 4 * i + face, i, u, v)
    return 12


@njit(cache=True)
def _more_cuts(
    grip: Grip, internal: _Internal, cuts: _Cuts, value: float, forces: Array, m: int, tolerance: float
) -> int:
    """Append a row where the forces leave the exact cone; return how many rows there are then."""
    least = value - max(tolerance, 1e-12 * (1.0 + abs(value)))
    for i in range(3):
        press, u, v = 0.0, 0.0, 0.0
        for k in range(3):
            press -= grip.normals[i, k] * forces[i, k]
            u += cuts.T[i, 0, k] * forces[i, k]
            v += cuts.T[i, 1, k] * forces[i, k]
        size = (u * u + v * v) ** 0.5
        if press - size / grip.mu < least and size > 0.0 and m < _MAX_ROWS:
            _cut(grip, internal, cuts, m, i, u / size, v / size)
            m += 1
    return m


@njit(cache=True)
def _forces(internal: _Internal, y: Array, forces: Array) -> None:
    forces[:] = 0.0
    for j in range(3):
        x = internal.x0[j] + internal.Q[0, j] * y[0] + internal.Q[1, j] * y[1]
        for i in range(3):
            for k in range(3):
                forces[i, k] += x * internal.X[i, j, k]


@njit(cache=True)
def _gradients(grip: Grip, cuts: _Cuts, best: _Optimum, slopes: Slopes) -> None:
    """Envelope theorem: d value = sum_i (P_i . df_i + dP_i . f_i), P_i = sum_k lam_k q_k + value n_i.

    The multiplier of sum N_i = 1 is the value itself, as everything is homogeneous in the forces.
    """
    normals, T, forces, value = grip.normals, cuts.T, slopes.forces, best.y[2]
    dp, dn = slopes.by_points, slopes.by_normals
    P = np.zeros((3, 3))
    U = np.zeros((3, 2))
    weight = np.zeros(3)
    for a in range(3):
        k, share = best.B[a], max(best.lam[a], 0.0)
        i = int(cuts.owner[k])
        weight[i] += share
        U[i, 0] += share * cuts.u[k] / grip.mu
        U[i, 1] += share * cuts.v[k] / grip.mu
    for i in range(3):
        for k in range(3):
            P[i, k] = (value - weight[i]) * normals[i, k] - U[i, 0] * T[i, 0, k] - U[i, 1] * T[i, 1, k]
    # internal forces x_ij of the chords: recovered from the forces, f_i = sum_j x_ij (p_j - p_i)
    x = np.zeros((3, 3))
    _internal(grip.points, forces, x)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                dp[i, k] += 3.0 * x[i, j] * (P[j, k] - P[i, k])
    g1, g2 = np.empty(3), np.empty(3)
    for i in range(3):
        for k in range(3):
            dn[i, k] = 3.0 * (value - weight[i]) * forces[i, k]
            g1[k] = -3.0 * U[i, 0] * forces[i, k]
            g2[k] = -3.0 * U[i, 1] * forces[i, k]
        # the direction of friction is free: only its turning out of the tangent plane counts
        out1 = out2 = 0.0
        for k in range(3):
            out1 += g1[k] * normals[i, k]
            out2 += g2[k] * normals[i, k]
        for k in range(3):
            dn[i, k] -= out1 * T[i, 0, k] + out2 * T[i, 1, k]
        radial = 0.0
        for k in range(3):
            radial += dn[i, k] * normals[i, k]
        for k in range(3):
            dn[i, k] -= radial * normals[i, k]


@njit(cache=True)
def _internal(points: Array, forces: Array, x: Array) -> None:
    """Solve f_0 = x01 (p1 - p0) + x02 (p2 - p0), f_1 likewise, in the plane of the triangle."""
    for i in range(2):
        j, k = 1 - i, 2
        aa = ab = bb = fa = fb = 0.0
        for c in range(3):
            a, b = points[j, c] - points[i, c], points[k, c] - points[i, c]
            aa += a * a
            ab += a * b
            bb += b * b
            fa += forces[i, c] * a
            fb += forces[i, c] * b
        D = aa * bb - ab * ab
        x[i, j] = (fa * bb - fb * ab) / D
        x[i, k] = x[k, i] = (aa * fb - ab * fa) / D


@njit(cache=True)
def cone_margin(points: Array, normals: Array, mu: float) -> tuple[float, Array, Array]:
    """Return the margin of closure of three contacts to about 1e-9, and its gradients; no checks.

    A value r says: contact forces exist that balance and press 1 N in all, and each contact has
    |f_t| <= mu (N_i - r / 3): it presses r / 3 more than friction needs.

    Args:
        points: (3, 3) metres. normals: (3, 3) unit, out of the object. mu: friction coefficient.

    Returns:
        value (at most 1; > 0: closure), d value / d points (3, 3) [1/m], d value / d normals (3, 3).
        Contacts on a line, or unable to press, give `UNDEFINED` and zeros.
    """
    slopes = Slopes(np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)))
    return _margin(Grip(points, normals, mu), slopes), slopes.by_points, slopes.by_normals


@njit(cache=True)
def _batch(grips: Grip, values: Array, out: Slopes) -> None:
    """Like `_margin`, where every array has K of them."""
    for k in range(values.shape[0]):
        grip = Grip(grips.points[k], grips.normals[k], grips.mu)
        values[k] = _margin(grip, Slopes(out.by_points[k], out.by_normals[k], out.forces[k]))


@njit(cache=True)
def rough_margins(points: Array, normals: Array, mu: float, tolerance: float) -> Array:
    """Return the margins (K,) of grasps, at most `tolerance` too high; without closure, any number not above 0.

    For ranking, in a fraction of the time of `margins`; no checks.

    Args:
        points: (K, 3, 3) metres. normals: (K, 3, 3) unit, out of the object. mu: friction coefficient.
        tolerance: in units of the margin.
    """
    values, forces = np.empty(points.shape[0]), np.empty((3, 3))
    best = _Optimum(np.empty(3), np.empty(3), np.empty(3, np.int64))
    for k in range(values.shape[0]):
        grip = Grip(points[k], normals[k], mu)
        values[k] = _optimise(grip, _empty_cuts(grip), best, forces, tolerance, 0.0)
    return values


def margins(points: Numbers, normals: Numbers, mu: float) -> tuple[Array, Array, Array, Array]:
    """Margins of K three-contact grasps.

    Args:
        points: (K, 3, 3) metres. normals: (K, 3, 3) unit, out of the object. mu: friction coefficient.

    Returns:
        values (K,) as `cone_margin` says, d/d points (K, 3, 3), d/d normals (K, 3, 3), the forces at the
        optimum (K, 3, 3), which balance and press 1 N in all.
    """
    points = check_array("points", points, (None, 3, 3))
    normals = check_array("normals", normals, (len(points), 3, 3))
    check_unit(normals)
    values, out = np.empty(len(points)), Slopes(*(np.empty_like(points) for _ in range(3)))
    _batch(Grip(points, normals, check_positive("mu", mu)), values, out)
    return values, *out
