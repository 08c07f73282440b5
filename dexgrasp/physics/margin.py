"""How far a grasp is from losing force closure, with gradients.

The **margin** is the min-weight metric (Shaw Cortez; FRoGGeR, 2023) taken to the exact cone (Eq. 1). Forces
in equilibrium at three contacts are the internal forces of their triangle (see `equilibrium`); with N_i the
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

from dexgrasp.physics.checks import Numbers, check_array, check_positive, check_unit
from dexgrasp.physics.equilibrium import internal_forces, middle_and_inverse
from dexgrasp.physics.programme import Programme, begin, empty_programme, maximise, set_cones
from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import njit

UNDEFINED = -1e3
"""Value of triples on a line, and of those whose internal forces cannot press at all; values end there."""
_LINE = 1e-6  # height of a triangle over its longest side
_FACES, _ROUNDS = 4, 45
_EXACT = 6e-11
_NOTHING = 1e-7  # N that internal forces of 1 N press with
_UNKNOWNS = (0, 0, 0)  # two of the internal forces that press 1 N in all, and the value


class _Room(NamedTuple):
    """What a margin and its gradients are worked out in."""

    programme: Programme
    friction: Array  # (3,)
    internal: Array  # (3, 3, 3) internal forces: contact, axis, force
    mirror: Array  # (3,) normal of the mirror that reflects them
    pull: Array  # (3, 3) what a shift of each force gains
    by_points: Array  # (3, 3) 1/m
    by_normals: Array  # (3, 3)


@njit
def _empty_room(mu: float) -> _Room:
    p = empty_programme(3, _UNKNOWNS, 3 * (_FACES + _ROUNDS))
    return _Room(
        p, np.full(3, mu), np.empty((3, 3, 3)), np.empty(3), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    )  # fmt: skip


@njit
def _optimum(points: Array, normals: Array, room: _Room, tolerance: float, enough: float) -> float:
    """Return the margin, at most `tolerance` too high, or any bound of it from above that is not above `enough`.

    It is three times the largest t for which each force still is in its cone when it presses t less.
    """
    p = room.programme
    if not internal_forces(points, room.internal) > _LINE:
        return UNDEFINED
    set_cones(p, normals, room.friction)
    if not _press_one(normals, room):
        return UNDEFINED
    begin(p, 1.0, _FACES)
    if not maximise(p, _ROUNDS, tolerance * room.friction[0] / 3.0, enough / 3.0) or p.lp.basis.min() < 0:
        return UNDEFINED
    return max(3.0 * p.lp.z[2], UNDEFINED)


@njit
def _press_one(normals: Array, room: _Room) -> bool:
    """Write the programme's forces: internal ones that press 1 N in all, t outwards each; False where there are none.

    A reflection of the internal forces turns what they press with to the last of them: of those it makes, all others
    press with nothing in all.
    """
    p, internal, mirror, last = room.programme, room.internal, room.mirror, len(room.mirror) - 1
    squared = 0.0
    for q in range(last + 1):
        mirror[q] = 0.0
        for i in range(3):
            for k in range(3):
                mirror[q] -= normals[i, k] * internal[i, k, q]
        squared += mirror[q] ** 2
    if squared < _NOTHING**2:
        return False
    press = -np.copysign(np.sqrt(squared), mirror[last])  # N, of the last of the reflected forces
    mirror[last] -= press
    for i in range(3):
        for k in range(3):
            part = 0.0
            for q in range(last + 1):
                part += internal[i, k, q] * mirror[q]
            part /= press * mirror[last]
            for q in range(last):
                p.span[i, k, q] = internal[i, k, q] + part * mirror[q]
            p.fixed[i, k] = (internal[i, k, last] + part * mirror[last]) / press
            p.span[i, k, last] = normals[i, k]
    return True


@njit
def _margin(points: Array, normals: Array, room: _Room) -> float:
    """Return the value of `cone_margin`; write gradients and the forces at the optimum."""
    p = room.programme
    room.by_points[:] = 0.0
    room.by_normals[:] = 0.0
    value = _optimum(points, normals, room, _EXACT, -np.inf)
    if value == UNDEFINED:
        p.forces[:] = 0.0
        return value
    for i in range(3):
        for k in range(3):
            p.forces[i, k] -= p.lp.z[2] * normals[i, k]
    _gradients(points, normals, room)
    return value


@njit
def _gradients(points: Array, normals: Array, room: _Room) -> None:
    """Envelope theorem: d value = 3 sum_i (P_i . df_i + dP_i . f_i), P_i = sum_k multiplier_k plane_k + t n_i.

    The multiplier of the sum of presses is t itself, as everything is homogeneous in the forces. At the optimum no
    internal force has any gain, so the P_i are velocities of a rigid triangle: its turn tells what moved points gain.
    """
    p, pull, lp = room.programme, room.pull, room.programme.lp
    for i in range(3):
        for k in range(3):
            pull[i, k] = lp.z[2] * normals[i, k]
            for row in range(3):
                if p.owner[lp.basis[row]] == i:
                    pull[i, k] += lp.multipliers[row] * p.planes[lp.basis[row], k]
    middle, inverse, moment, turn = np.empty(3), np.empty((3, 3)), np.zeros(3), np.zeros(3)
    middle_and_inverse(points, middle, inverse)
    for i in range(3):
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            moment[k] += (points[i, a] - middle[a]) * pull[i, b] - (points[i, b] - middle[b]) * pull[i, a]
    for k in range(3):
        for a in range(3):
            turn[k] += inverse[k, a] * moment[a]
    for i in range(3):
        along = across = 0.0
        for k in range(3):
            along += normals[i, k] * pull[i, k]
            across += normals[i, k] * p.forces[i, k]
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            room.by_points[i, k] = 3.0 * (turn[a] * p.forces[i, b] - turn[b] * p.forces[i, a])
            room.by_normals[i, k] = 3.0 * (along * p.forces[i, k] - across * pull[i, k])


@njit
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
    room = _empty_room(mu)
    return _margin(points, normals, room), room.by_points, room.by_normals


@njit
def rough_margins(points: Array, normals: Array, mu: float, tolerance: float) -> Array:
    """Return the margins (K,) of grasps, at most `tolerance` too high; without closure, any number not above 0.

    For ranking, in a fraction of the time of `margins`; no checks.

    Args:
        points: (K, 3, 3) metres. normals: (K, 3, 3) unit, out of the object. mu: friction coefficient.
        tolerance: in units of the margin.
    """
    values, room = np.empty(points.shape[0]), _empty_room(mu)
    for k in range(values.shape[0]):
        values[k] = _optimum(points[k], normals[k], room, tolerance, 0.0)
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
    values, out = np.empty(len(points)), np.empty((3, *points.shape))
    _margins(points, normals, check_positive("mu", mu), values, out)
    return values, *out


@njit
def _margins(points: Array, normals: Array, mu: float, values: Array, out: Array) -> None:
    """Like `_margin`, for K of them; `out` (3, K, 3, 3) are gradients by points, by normals, and forces."""
    room = _empty_room(mu)
    for g in range(values.shape[0]):
        values[g] = _margin(points[g], normals[g], room)
        for i in range(3):
            for k in range(3):
                out[0, g, i, k], out[1, g, i, k] = room.by_points[i, k], room.by_normals[i, k]
                out[2, g, i, k] = room.programme.forces[i, k]
