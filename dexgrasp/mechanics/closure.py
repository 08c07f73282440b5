"""Sweep of contact triples for force closure: Eq. 4 in closed form, millions of triples a second.

A triple is **feasible** when the least value of Eq. 4, |sum f|^2 + |sum (p - c) x f / L|^2 with f_min = 1,
pyramid cones (Eq. 2) and c the centroid of the three contacts, is below `TOLERANCE`.

Three forces in equilibrium at points not on a line are internal forces, f_i = sum_j x_ij (p_j - p_i) with
x_ij = x_ji: three numbers (a, b, c) = (x12, x13, x23). The cone of contact 1 restricts (a, b) to a wedge,
that of 2 (a, c), that of 3 (b, c). With a = +-1 the first two are intervals of b and c, and the question is
whether a wedge meets a box: some 150 operations, no iteration. f_min scales away, as every non-zero force
in the cone presses.

The closed form is exact for residual zero. It differs from "below TOLERANCE" only near the edge, so triples
feasible at a friction `BAND` (2 %) larger but not at `mu` go to a programme; so do flat triples, in a band that
widens as 1 / height, and those on a line. The programme ends with a proof: forces with a small wrench, or
directions in which no wrench is small.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dexgrasp.mechanics.closure_closed_form import chord_tables, closed_form, flatness
from dexgrasp.mechanics.contacts import Shape, shape_of
from dexgrasp.mechanics.equilibrium import grasp_map, rms_radius
from dexgrasp.mechanics.margin_lp import Programme, add_presses, begin, empty_programme, set_cones
from dexgrasp.mechanics.simplex import Simplex, solve
from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import njit

TOLERANCE = 1e-6
BAND = 1.02
FLAT = 0.15
"""Triangles whose height is below this part of their longest side get the wider band."""
LINE = 4e-3
"""Below this part they count as lying on a line and always go to the programme."""
_FACES, _ROUNDS = 4, 60
_ROUNDING = 1e-9

Triples = NDArray[np.int32]


class _Cloud(NamedTuple):
    """Contacts with what is looked up for each pair of them (`chord_tables`), and when triples of them count."""

    points: Array  # (n, 3)
    normals: Array  # (n, 3)
    E: Array  # (n, n, 3)
    T: Array  # (n, n, 3)
    D: Array  # (n, n)
    mu: float
    scale: float  # divides torques
    near: float  # least squared distance of two


@njit
def _balances(p: Programme, cloud: _Cloud, triple: tuple[int, int, int]) -> bool:
    """Return True where forces in a triple's cones, 1 N or more pressing, have a wrench |w|^2 below TOLERANCE.

    The last unknown t is at most -u . w for directions u, those of axes and of wrenches found: none is less than -t.
    """
    points, normals, friction = np.empty((3, 3)), np.empty((3, 3)), np.full(3, cloud.mu)
    for i, which in enumerate(triple):
        points[i], normals[i] = cloud.points[which], cloud.normals[which]
    set_cones(p, normals, friction)
    begin(p, 0.0, _FACES)
    add_presses(p, normals, 1.0)
    centre = (points[0] + points[1] + points[2]) / 3.0
    lp, w, G = p.lp, np.zeros(6), grasp_map(points, centre, cloud.scale)
    for k in range(6):
        for sign in (1.0, -1.0):
            w[k] = sign
            _bound(lp, G, w)
        w[k] = 0.0
    for _ in range(_ROUNDS):
        if not solve(lp, _ROUNDING):
            break
        value = 0.0
        for k in range(6):
            w[k] = 0.0
            for i in range(9):
                w[k] += G[k, i] * lp.z[i]
            value += w[k] * w[k]
        if value < TOLERANCE or lp.z[9] ** 2 >= TOLERANCE:
            return value < TOLERANCE
        w /= value**0.5
        _bound(lp, G, w)
    return False


@njit
def _bound(lp: Simplex, G: Array, u: Array) -> None:
    """Ask that t be at most -u . G f, u (6,) of length 1."""
    row = lp.size[0]
    lp.b[row], lp.A[row, 9], lp.size[0] = 0.0, -1.0, row + 1
    for i in range(9):
        lp.A[row, i] = 0.0
        for k in range(6):
            lp.A[row, i] -= G[k, i] * u[k]


@njit
def _wider(mu: float, flat2: float) -> float:
    """The friction up to which a triple of this (height / side)^2 may still be feasible within TOLERANCE."""
    if flat2 >= FLAT * FLAT:
        return mu * BAND
    return mu * BAND + 3.0 * TOLERANCE**0.5 / flat2**0.5


@njit
def _sweep(cloud: _Cloud, shape: Shape) -> Triples:
    """Return the feasible triples (M, 3) in lexicographic order."""
    E, T, D, mu, near = cloud.E, cloud.T, cloud.D, cloud.mu, cloud.near
    # three forces in world axes, and the least value's negative root
    p = empty_programme(shape, 10, 3 * (_FACES + 1) + 12 + _ROUNDS)
    p.span[:] = 0.0
    for i in range(9):
        p.span[i // 3, i % 3, i] = 1.0
    n, m, triples = len(D), 0, np.empty((1024, 3), np.int32)
    for i in range(n):
        for j in range(i + 1, n):
            if D[i, j] < near:
                continue
            for k in range(j + 1, n):
                if D[i, k] < near or D[j, k] < near:
                    continue
                flat2 = flatness(D[i, j], D[i, k], D[j, k])
                line = flat2 < LINE * LINE
                if not (line or closed_form(_wider(mu, flat2), E, T, i, j, k)):
                    continue
                if (line or not closed_form(mu, E, T, i, j, k)) and not _balances(p, cloud, (i, j, k)):
                    continue
                if m == len(triples):
                    triples = np.concatenate((triples, np.empty_like(triples)))
                triples[m, 0], triples[m, 1], triples[m, 2] = i, j, k
                m += 1
    return triples[:m]


def closure_sweep(
    points: Array, normals: Array, mu: float, min_distance: float = 0.03, length_scale: float | None = None
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
    if len(points) < 3:
        return np.empty((0, 3), np.int32)
    points, normals = np.ascontiguousarray(points), np.ascontiguousarray(normals)
    scale = rms_radius(points) if length_scale is None else length_scale
    return _sweep(
        _Cloud(points, normals, *chord_tables(points, normals), mu, scale, min_distance**2), shape_of(3)
    )


def opposed_pairs(
    points: Array, normals: Array, mu: float, min_distance: float, max_distance: float = np.inf
) -> Triples:
    """Return every pair of contact points whose line lies in both friction cones.

    Args:
        points: (n, 3) metres.
        normals: (n, 3) unit, out of the object.
        mu: friction coefficient.
        min_distance: pairs nearer than this [m] are left out.
        max_distance: and those farther apart.

    Returns:
        (M, 2) int32 indices, i < j, in lexicographic order.
    """
    way = points[None] - points[:, None]
    distance = np.linalg.norm(way, axis=2)
    inwards = -(way * normals[:, None]).sum(2)  # how far the other point is behind the surface at each
    facing = inwards > distance / np.sqrt(1.0 + mu**2)
    pairs = np.triu(facing & facing.T & (distance >= min_distance) & (distance <= max_distance), 1)
    return np.argwhere(pairs).astype(np.int32)
