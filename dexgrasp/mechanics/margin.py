"""Closure margin: the distance of a grasp from losing force closure, with gradients.

The **margin** is the min-weight metric (Shaw Cortez; FRoGGeR, 2023) taken to the exact cone (Eq. 1). Forces
in equilibrium at n contacts are their internal forces (see `equilibrium`); with N_i the pressing and f_t,i the
tangential part of each, for soft contacts with what turns about the normal,

    margin = n max over internal forces, with sum N_i = 1, of min_i [N_i - |f_t,i| / mu].

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

from dexgrasp.geometry.triangle import cross
from dexgrasp.mechanics.contact_models import ContactModel, HardFinger
from dexgrasp.mechanics.contacts import Shape, shape_of
from dexgrasp.mechanics.equilibrium import contact_map, internal_forces, middle_and_inverse
from dexgrasp.mechanics.margin_lp import Programme, begin, empty_programme, maximise, set_cones
from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import leaf, njit

UNDEFINED = -1e3
"""Value of triples on a line, and of those whose internal forces cannot press at all; values end there."""
_FACES, _ROUNDS = 4, 45
_EXACT = 6e-11


class _Room(NamedTuple):
    """Work arrays of a margin and its gradients."""

    programme: Programme
    torsion: float | None  # of the contact model
    friction: Array  # (N,)
    internal: Array  # (N, c, k) internal forces: contact, part, force
    mirror: Array  # (k,) normal of the mirror that reflects them
    pull: Array  # (N, c) what a shift of each force gains
    by_points: Array  # (N, 3) 1/m
    by_normals: Array  # (N, 3)


@njit
def _empty_room(mu: float, shape: Shape) -> _Room:
    n, c, k = shape.contacts, len(shape.model.parts), shape.internal
    p = empty_programme(shape, shape.internal, n * (_FACES + _ROUNDS))
    return _Room(
        p, shape.model.torsion, np.full(n, mu), np.empty((n, c, k)), np.empty(k), np.empty((n, c)), np.empty((n, 3)),
        np.empty((n, 3)),
    )  # fmt: skip


@njit
def _optimum(points: Array, normals: Array, room: _Room, tolerance: float, enough: float) -> float:
    """Return the margin, at most `tolerance` too high, or any bound of it from above that is not above `enough`.

    It is n times the largest t for which each force still is in its cone when it presses t less.
    """
    p, n = room.programme, len(points)
    # height of a triangle over its longest side
    if not internal_forces(points, normals, room.torsion, room.internal) > 1e-6:
        return UNDEFINED
    set_cones(p, normals, room.friction)
    if not _press_one(normals, room):
        return UNDEFINED
    begin(p, 1.0, _FACES)
    if not maximise(p, _ROUNDS, tolerance * room.friction[0] / n, enough / n) or p.lp.basis.min() < 0:
        return UNDEFINED
    return max(n * p.lp.z[-1], UNDEFINED)


@leaf
def _press_one(normals: Array, room: _Room) -> bool:
    """Write the programme's forces: internal ones that press 1 N in all, t outwards each; False where there are none.

    A reflection of the internal forces turns what they press with to the last of them: of those it makes, all others
    press with nothing in all.
    """
    p, internal, mirror, last = room.programme, room.internal, room.mirror, len(room.mirror) - 1
    squared = 0.0
    for q in range(last + 1):
        mirror[q] = 0.0
        for i in range(len(normals)):
            for k in range(3):
                mirror[q] -= normals[i, k] * internal[i, k, q]
        squared += mirror[q] ** 2
    if squared < 1e-7**2:  # N that internal forces of 1 N press with
        return False
    press = -np.copysign(np.sqrt(squared), mirror[last])  # N, of the last of the reflected forces
    mirror[last] -= press
    for i in range(len(normals)):
        for k in range(len(p.parts)):
            part = 0.0
            for q in range(last + 1):
                part += internal[i, k, q] * mirror[q]
            part /= press * mirror[last]
            for q in range(last):
                p.span[i, k, q] = internal[i, k, q] + part * mirror[q]
            p.fixed[i, k] = (internal[i, k, last] + part * mirror[last]) / press
            p.span[i, k, last] = normals[i, k] if k < 3 else 0.0
    return True


@njit
def _gradients(points: Array, normals: Array, room: _Room) -> None:
    """Envelope theorem: d value = n sum_i (P_i . df_i + dP_i . f_i), P_i = sum_k multiplier_k plane_k + t n_i.

    The multiplier of the sum of presses is t itself, as everything is homogeneous in the forces. At the optimum no
    internal force has any gain, so the P_i are velocities of a rigid body: its turn tells what moved points gain.
    """
    p, pull, lp, n = room.programme, room.pull, room.programme.lp, len(points)
    pull[:] = 0.0
    pull[:, :3] = lp.z[-1] * normals
    for row in range(len(lp.z)):
        pull[p.owner[lp.basis[row]]] += lp.multipliers[row] * p.planes[lp.basis[row]]
    turn = _turn(points, normals, room)
    for i in range(n):
        normal, force, pulled = normals[i], p.forces[i, :3], pull[i, :3]
        along, across, about = (normal * pulled).sum(), (normal * force).sum(), (normal * turn).sum()
        cross(turn, force, room.by_points[i])
        room.by_points[i] *= n
        room.by_normals[i] = n * (along * force - across * pulled)
        _add_torsion(n * p.forces[i, -1], room.torsion, turn - about * normal, room.by_normals[i])


@njit
def _add_torsion(force: float, torsion: float | None, turn: Array, by_normal: Array) -> None:
    if torsion is not None:
        by_normal -= force * torsion * turn


@njit
def _turn(points: Array, normals: Array, room: _Room) -> Array:
    """Return the turn (3,) nearest to velocities that the contacts pull with."""
    if not np.isfinite(room.pull).all():  # of a programme that has come to nothing
        return np.zeros(3)
    return _turn_of(points, normals, room.torsion, room.pull)


@njit
def _turn_of(points: Array, normals: Array, torsion: float | None, pull: Array) -> Array:
    turn = np.zeros(3)
    if torsion is None:
        middle, inverse, moment, part = np.empty(3), np.empty((3, 3)), np.zeros(3), np.empty(3)
        middle_and_inverse(points, middle, inverse)
        for i in range(len(points)):
            cross(points[i] - middle, pull[i], part)
            moment += part
        for k in range(3):
            turn[k] = (inverse[k] * moment).sum()
    else:
        G = contact_map(points, normals, torsion, points[0], 1.0)
        turn[:] = np.linalg.solve(G @ G.T, G @ pull.ravel())[3:]
    return turn


@njit
def cone_margin(points: Array, normals: Array, mu: float, shape: Shape) -> tuple[float, Array, Array, Array]:
    """Return the margin of closure of contacts to about 1e-9, its gradients, and the forces there; no checks.

    A value r says: contact forces exist that balance and press 1 N in all, and each contact has
    |f_t| <= mu (N_i - r / n): it presses r / n more than friction needs.

    Args:
        points: (n, 3) metres. normals: (n, 3) unit, out of the object. mu: friction coefficient.
        shape: of the contacts.

    Returns:
        value (at most 1; > 0: closure), d value / d points (n, 3) [1/m], d value / d normals (n, 3), and the
        forces (n, c) that balance and press 1 N in all.
        Contacts of a lower rank than 6, as on a line, or unable to press, give `UNDEFINED` and zeros.
    """
    room = _empty_room(mu, shape)
    p = room.programme
    room.by_points[:] = 0.0
    room.by_normals[:] = 0.0
    value = _optimum(points, normals, room, _EXACT, -np.inf)
    if value == UNDEFINED:
        p.forces[:] = 0.0
    else:
        p.forces[:, :3] -= p.lp.z[-1] * normals
        _gradients(points, normals, room)
    return value, room.by_points, room.by_normals, p.forces


@njit
def margins_to(
    points: Array, normals: Array, mu: float, shape: Shape, tolerance: float, enough: float
) -> Array:
    """Return the margins (K,) of grasps, at most `tolerance` too high; not above `enough`, any number that is not.

    For ranking, in a fraction of the time that `cone_margin` takes; no checks.

    Args:
        points: (K, n, 3) metres. normals: (K, n, 3) unit, out of the object. mu: friction coefficient.
        shape: of the contacts.
        tolerance: in units of the margin.
        enough: the same.
    """
    values, room = np.empty(points.shape[0]), _empty_room(mu, shape)
    for k in range(values.shape[0]):
        values[k] = _optimum(points[k], normals[k], room, tolerance, enough)
    return values


def margins(points: Array, normals: Array, mu: float, model: ContactModel = HardFinger()) -> Array:  # noqa: B008
    """Return the margins (K,) of K grasps of n contacts, as `cone_margin` says.

    Args:
        points: (K, n, 3) metres.
        normals: (K, n, 3) unit, out of the object.
        mu: friction coefficient.
        model: of the contacts; hard fingers are at least three.
    """
    shape = shape_of(points.shape[1], model)
    if len(model.parts) * shape.contacts < 6 + (shape.contacts < 3):  # rank 5 at most, whatever the points
        return np.full(len(points), UNDEFINED)
    contiguous = np.ascontiguousarray
    return margins_to(contiguous(points), contiguous(normals), float(mu), shape, _EXACT, -np.inf)
