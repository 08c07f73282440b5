"""Linear programmes of contact forces in friction cones, exact by cutting planes: the largest t for which some exist.

The force of contact i is f_i = fixed_i + span_i z, with unknowns z of which the last is t. Where a push of size t, in
whatever direction u, asks for -t answer_i u besides, it lies in its cone for all of them if

    a . f_i >= t |answer_i^T a|

for each plane that touches the cone, a its inward normal. Forces have c parts, of soft contacts four. A programme
starts with a few planes of each cone; those that its forces break are added until they break none. Squeeze,
capacity and margin of a grasp are such programmes.
"""

from typing import NamedTuple

import numpy as np

from dexgrasp.mechanics.cones import basis_of
from dexgrasp.mechanics.contacts import Contacts, Shape
from dexgrasp.mechanics.robust_push import (
    Friction,
    Plane,
    along,
    asked,
    borne_push,
    each_along,
    touching_plane,
)
from dexgrasp.mechanics.simplex import Simplex, empty_simplex, restart, solve
from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.compiled import leaf, njit

_HALF = 0.5**0.5


class Programme(NamedTuple):
    """A programme for N contacts in n unknowns."""

    cones: Array  # (N, 3, 3) -friction x normal, and two tangents
    fixed: Array  # (N, c) N
    span: Array  # (N, c, n) N
    answers: Array  # (N, c, 3) N, to a push of 1 along each axis; zeros where t is no push in all directions
    forces: Array  # (N, c) N, of the solution
    owner: Index  # (rows at most,) whose force each row bounds
    planes: Array  # (rows at most, c) and in which direction
    lp: Simplex
    parts: tuple[int, ...]  # c zeros


@njit
def empty_programme(shape: Shape, n: int, rows: int) -> Programme:
    """Return room for a programme of n unknowns and at most so many rows, `fixed` and `answers` 0."""
    N, c = shape.contacts, len(shape.model.parts)
    if c == 4:
        rows = 4 * rows  # see `begin`
    return Programme(
        np.empty((N, 3, 3)), np.zeros((N, c)), np.empty((N, c, n)), np.zeros((N, c, 3)), np.empty((N, c)),
        np.empty(rows, np.int64), np.empty((rows, c)), empty_simplex(n, rows), shape.model.parts,
    )  # fmt: skip


@leaf
def set_cones(p: Programme, normals: Array, friction: Array) -> None:
    """Take the cones of contacts: normals (N, 3) out of the object, friction (N,)."""
    for i in range(normals.shape[0]):
        basis = basis_of(normals[i, 0], normals[i, 1], normals[i, 2])
        for k in range(3):
            p.cones[i, 0, k] = -friction[i] * normals[i, k]
            p.cones[i, 1, k], p.cones[i, 2, k] = basis[k], basis[3 + k]


@leaf
def begin(p: Programme, most: float, faces: int) -> None:
    """Start with `faces` planes of each cone, and t at most `most`; `fixed`, `span` and `answers` are written."""
    restart(p.lp, most)
    step = 2.0 * np.pi / faces
    for k in range(faces):
        for i in range(p.cones.shape[0]):
            u, v = np.cos(k * step), np.sin(k * step)
            _add_plane(p, i, (u, v, 0.0))
            if len(p.parts) == 4:
                _add_plane(p, i, (_HALF * u, _HALF * v, _HALF))
                _add_plane(p, i, (_HALF * u, _HALF * v, -_HALF))
    if len(p.parts) == 4:
        for i in range(p.cones.shape[0]):
            _add_plane(p, i, (0.0, 0.0, 1.0))
            _add_plane(p, i, (0.0, 0.0, -1.0))


@leaf
def _add_plane(p: Programme, i: int, friction: Friction) -> None:
    """Add the plane that touches cone i where friction points in a direction of length 1."""
    plane = touching_plane(p.cones[i], friction)
    _add_row(p, i, plane, asked(plane, p.answers[i]), 0.0)


@leaf
def _add_row(p: Programme, i: int, plane: Plane, need: float, bound: float) -> None:
    """Ask that plane . f_i - need t >= bound."""
    A, r, n = p.lp.A, p.lp.size[0], len(p.lp.z)
    for k in range(n):
        A[r, k] = each_along(plane, p.span[i], k)
    A[r, n - 1] -= need
    p.lp.b[r] = bound - along(plane, p.fixed[i])
    p.owner[r], p.planes[r, 0], p.planes[r, 1], p.planes[r, 2] = i, plane[0], plane[1], plane[2]
    if len(p.parts) == 4:
        p.planes[r, 3] = plane[3]
    p.lp.size[0] = r + 1


@leaf
def add_presses(p: Programme, normals: Array, press: float) -> None:
    """Ask of each contact to press with `press` N against the object."""
    for i in range(normals.shape[0]):
        _add_row(p, i, (-normals[i, 0], -normals[i, 1], -normals[i, 2], 0.0), 0.0, press)


@leaf
def add_torques(p: Programme, contacts: Contacts, reserved: float) -> None:
    """Keep joints within their torques, also as they answer what a push has beyond `reserved` (inf: nothing)."""
    for i in range(contacts.jacobians.shape[0]):
        for j in range(contacts.jacobians.shape[2]):
            if not _moves_first(contacts.jacobians, i, j):
                continue
            for scale in (1.0 / contacts.torque_limits[j], -1.0 / contacts.torque_limits[j]):
                _add_torque(p, contacts.jacobians, (i, j), scale, 0.0, 0.0)
                if reserved < np.inf:
                    _add_torque(p, contacts.jacobians, (i, j), scale, 1.0, reserved)


@leaf
def _moves(jacobians: Array, i: int, j: int) -> bool:
    J = jacobians[i]
    return not (J[0, j] == 0.0 and J[1, j] == 0.0 and J[2, j] == 0.0)


@leaf
def _moves_first(jacobians: Array, i: int, j: int) -> bool:
    """Return True where contact i is the first that joint j moves."""
    first = 0
    while first < i and not _moves(jacobians, first, j):
        first += 1
    return first == i and _moves(jacobians, i, j)


@leaf
def _add_torque(
    p: Programme, jacobians: Array, of: tuple[int, int], scale: float, share: float, reserved: float
) -> None:
    """Ask that the forces' torque x `scale` is -1 at least, and stays so with that share of what answers beyond
    `reserved`; `of` is the first contact that the joint moves, and the joint.
    """
    lp, (i, j), ax, ay, az = p.lp, of, 0.0, 0.0, 0.0
    for k in range(i, jacobians.shape[0] if share > 0.0 else i):
        if not _moves(jacobians, k, j):
            continue
        plane = _torque(jacobians, (k, j), scale)
        ax += each_along(plane, p.answers[k], 0)
        ay += each_along(plane, p.answers[k], 1)
        az += each_along(plane, p.answers[k], 2)
    need = share * np.sqrt(ax * ax + ay * ay + az * az)
    _add_row(p, i, _torque(jacobians, (i, j), scale), need, -1.0 - reserved * need)
    r = lp.size[0] - 1
    for k in range(i + 1, jacobians.shape[0]):
        if not _moves(jacobians, k, j):
            continue
        plane = _torque(jacobians, (k, j), scale)
        for q in range(len(lp.z)):
            lp.A[r, q] += each_along(plane, p.span[k], q)
        lp.b[r] -= along(plane, p.fixed[k])


@leaf
def _torque(J: Array, of: tuple[int, int], scale: float) -> Plane:
    i, j = of
    turn = scale * J[i, 3, j] if J.shape[1] == 4 else 0.0
    return scale * J[i, 0, j], scale * J[i, 1, j], scale * J[i, 2, j], turn


@leaf
def maximise(p: Programme, rounds: int, tolerance: float, enough: float) -> bool:
    """Write the solution's unknowns and forces; False where there is none.

    Args:
        p: with its rows.
        rounds: of cutting planes, at most.
        tolerance: N of friction that forces may be beyond their cones.
        enough: t below which no more planes are added: it is not above that; -inf asks for all of them.
    """
    lp, contacts = p.lp, p.cones.shape[0]
    for turn in range(rounds + 1):
        if not solve(lp, min(1e-9, 0.1 * tolerance)):  # N that a force may be beyond a plane
            return False
        for i in range(contacts):
            for k in range(len(p.parts)):
                p.forces[i, k] = p.fixed[i, k]
                for q in range(len(lp.z)):
                    p.forces[i, k] += p.span[i, k, q] * lp.z[q]
        if turn == rounds or lp.z[-1] <= enough:
            break
        before = lp.size[0]
        for i in range(contacts):
            _cut(p, i, tolerance)
        if lp.size[0] == before:
            break
    return True


@leaf
def _any(answers: Array, i: int) -> bool:
    for part in range(answers.shape[1]):
        for k in range(3):
            if answers[i, part, k] != 0.0:
                return True
    return False


@leaf
def _cut(p: Programme, i: int, tolerance: float) -> None:
    """Add the plane that a force breaks most, where it does by more than `tolerance`, N of friction."""
    u, v, turn = 0.0, 0.0, 0.0
    if _any(p.answers, i):
        _, (u, v, turn) = borne_push(p.cones[i], p.answers[i], p.forces[i])
    else:
        for k in range(3):
            u += p.cones[i, 1, k] * p.forces[i, k]
            v += p.cones[i, 2, k] * p.forces[i, k]
        if len(p.parts) == 4:
            turn = p.forces[i, 3]
        size = max(np.sqrt(u * u + v * v + turn * turn), 1e-300)
        u, v, turn = u / size, v / size, turn / size
    _add_plane(p, i, (u, v, turn))
    r = p.lp.size[0] - 1
    slack = -p.lp.b[r]
    for k in range(len(p.lp.z)):
        slack += p.lp.A[r, k] * p.lp.z[k]
    if slack >= -tolerance:
        p.lp.size[0] = r
