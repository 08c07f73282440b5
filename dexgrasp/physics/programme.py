"""The largest t for which some contact forces lie in friction cones: linear programmes, exact by cutting planes.

The force of contact i is f_i = fixed_i + span_i z, with unknowns z of which the last is t. Where a push of size t, in
whatever direction u, asks for -t answer_i u besides, it lies in its cone for all of them if

    a . f_i >= t |answer_i^T a|

for each plane that touches the cone, a its inward normal. A programme starts with a few planes of each cone; those that
its forces break are added until they break none. Squeeze, capacity and margin of a grasp are such programmes.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dexgrasp.physics.cones import basis_of
from dexgrasp.physics.contacts import Contacts
from dexgrasp.physics.simplex import Simplex, empty_simplex, restart, solve
from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import njit

_ROUNDING = 1e-9  # N that a force may be beyond a plane
_SCAN = 48  # angles at which the worst plane of a cone is looked for first
_SHARP = 1e-6  # rad to which it is found


class Programme(NamedTuple):
    """A programme for N contacts in n unknowns."""

    cones: Array  # (N, 3, 3) -friction x normal, and two tangents
    fixed: Array  # (N, 3) N
    span: Array  # (N, 3, n) N
    answers: Array  # (N, 3, 3) N, to a push of 1 along each axis; zeros where t is no push in all directions
    forces: Array  # (N, 3) N, of the solution
    owner: NDArray[np.int64]  # (rows at most,) whose force each row bounds
    planes: Array  # (rows at most, 3) and in which direction
    lp: Simplex


@njit
def empty_programme(contacts: int, unknowns: tuple[int, ...], rows: int) -> Programme:
    """Return room for a programme of at most so many rows, `fixed` and `answers` 0; `unknowns` as in `Simplex`."""
    n = len(unknowns)
    return Programme(
        np.empty((contacts, 3, 3)), np.zeros((contacts, 3)), np.empty((contacts, 3, n)), np.zeros((contacts, 3, 3)),
        np.empty((contacts, 3)), np.empty(rows, np.int64), np.empty((rows, 3)), empty_simplex(unknowns, rows),
    )  # fmt: skip


@njit
def set_cones(p: Programme, normals: Array, friction: Array) -> None:
    """Take the cones of contacts: normals (N, 3) out of the object, friction (N,)."""
    for i in range(normals.shape[0]):
        basis = basis_of(normals[i, 0], normals[i, 1], normals[i, 2])
        for k in range(3):
            p.cones[i, 0, k] = -friction[i] * normals[i, k]
            p.cones[i, 1, k], p.cones[i, 2, k] = basis[k], basis[3 + k]


@njit
def begin(p: Programme, most: float, faces: int) -> None:
    """Start with `faces` planes of each cone, and t at most `most`; `fixed`, `span` and `answers` are written."""
    restart(p.lp, most)
    step = 2.0 * np.pi / faces
    for k in range(faces):
        for i in range(p.cones.shape[0]):
            _add_plane(p, i, np.cos(k * step), np.sin(k * step))


@njit
def _add_plane(p: Programme, i: int, u: float, v: float) -> None:
    """Add the plane that touches cone i where friction points along (u, v), of length 1, in its tangents."""
    x, y, z = _plane(p, i, u, v)
    _add_row(p, i, x, y, z, _asked(p, i, x, y, z), 0.0)


@partial(njit, inline="always")
def _plane(p: Programme, i: int, u: float, v: float) -> tuple[float, float, float]:
    c = p.cones[i]
    return (
        c[0, 0] - u * c[1, 0] - v * c[2, 0], c[0, 1] - u * c[1, 1] - v * c[2, 1], c[0, 2] - u * c[1, 2] - v * c[2, 2]
    )  # fmt: skip


@partial(njit, inline="always")
def _asked(p: Programme, i: int, x: float, y: float, z: float) -> float:
    """How far the worst push of 1 moves the force of contact i against (x, y, z)."""
    total = 0.0
    for k in range(3):
        total += (x * p.answers[i, 0, k] + y * p.answers[i, 1, k] + z * p.answers[i, 2, k]) ** 2
    return np.sqrt(total)


@partial(njit, inline="always")
def _add_row(p: Programme, i: int, x: float, y: float, z: float, asked: float, bound: float) -> None:
    """Ask that (x, y, z) . f_i - asked t >= bound."""
    A, r, n = p.lp.A, p.lp.size[0], len(p.lp.unknowns)
    for k in range(n):
        A[r, k] = x * p.span[i, 0, k] + y * p.span[i, 1, k] + z * p.span[i, 2, k]
    A[r, n - 1] -= asked
    p.lp.b[r] = bound - (x * p.fixed[i, 0] + y * p.fixed[i, 1] + z * p.fixed[i, 2])
    p.owner[r], p.planes[r, 0], p.planes[r, 1], p.planes[r, 2] = i, x, y, z
    p.lp.size[0] = r + 1


@njit
def add_presses(p: Programme, normals: Array, press: float) -> None:
    """Ask of each contact to press with `press` N against the object."""
    for i in range(normals.shape[0]):
        _add_row(p, i, -normals[i, 0], -normals[i, 1], -normals[i, 2], 0.0, press)


@njit
def add_torques(p: Programme, contacts: Contacts, reserved: float) -> None:
    """Keep joints within their torques, also as they answer what a push has beyond `reserved` (inf: nothing)."""
    for i in range(contacts.jacobians.shape[0]):
        for j in range(contacts.jacobians.shape[2]):
            limit, J = contacts.torque_limits[j], contacts.jacobians[i, :, j]
            if J[0] == 0.0 and J[1] == 0.0 and J[2] == 0.0:
                continue
            for scale in (1.0 / limit, -1.0 / limit):
                x, y, z = scale * J[0], scale * J[1], scale * J[2]
                _add_row(p, i, x, y, z, 0.0, -1.0)
                if reserved < np.inf:
                    asked = _asked(p, i, x, y, z)
                    _add_row(p, i, x, y, z, asked, -1.0 - reserved * asked)


@njit
def maximise(p: Programme, rounds: int, tolerance: float, enough: float = -np.inf) -> bool:
    """Write the solution's unknowns and forces; False where there is none.

    Args:
        p: with its rows.
        rounds: of cutting planes, at most.
        tolerance: N of friction that forces may be beyond their cones.
        enough: t below which no more planes are added: it is not above that.
    """
    lp, contacts = p.lp, p.cones.shape[0]
    for turn in range(rounds + 1):
        if not solve(lp, min(_ROUNDING, 0.1 * tolerance)):
            return False
        for i in range(contacts):
            for k in range(3):
                p.forces[i, k] = p.fixed[i, k]
                for q in range(len(lp.unknowns)):
                    p.forces[i, k] += p.span[i, k, q] * lp.z[q]
        if turn == rounds or lp.z[-1] <= enough:
            break
        before = lp.size[0]
        for i in range(contacts):
            _cut(p, i, tolerance)
        if lp.size[0] == before:
            break
    return True


@njit
def _cut(p: Programme, i: int, tolerance: float) -> None:
    """Add the plane that a force breaks most, where it does by more than `tolerance`, N of friction."""
    if p.answers[i].any():
        _, u, v = _borne_by(p, i)
    else:
        u, v = 0.0, 0.0
        for k in range(3):
            u += p.cones[i, 1, k] * p.forces[i, k]
            v += p.cones[i, 2, k] * p.forces[i, k]
        size = max(np.sqrt(u * u + v * v), 1e-300)
        u, v = u / size, v / size
    _add_plane(p, i, u, v)
    r = p.lp.size[0] - 1
    slack = -p.lp.b[r]
    for k in range(len(p.lp.unknowns)):
        slack += p.lp.A[r, k] * p.lp.z[k]
    if slack >= -tolerance:
        p.lp.size[0] = r


@njit
def borne(p: Programme) -> float:
    """Return the t that the forces bear: the largest for which all stay in their cones whatever is asked of them."""
    least = np.inf
    for i in range(p.cones.shape[0]):
        least = min(least, _borne_by(p, i)[0])
    return least


@njit
def _borne_by(p: Programme, i: int) -> tuple[float, float, float]:
    """The t that one force bears, and the direction (u, v) of friction at the plane that says so.

    There may be two such planes that say nearly the same, so every minimum of the scan is followed to its end.
    """
    step, least, worst = 2.0 * np.pi / _SCAN, np.inf, 0.0
    before, here = _ratio(p, i, -2.0 * step), _ratio(p, i, -step)
    for k in range(_SCAN):
        after = _ratio(p, i, k * step)
        if here <= min(before, after):
            value, angle = _lowest(p, i, (k - 1) * step, here, step)
            if value < least:
                least, worst = value, angle
        before, here = here, after
    return least, np.cos(worst), np.sin(worst)


@njit
def _lowest(p: Programme, i: int, angle: float, value: float, step: float) -> tuple[float, float]:
    """Follow a minimum of the ratio within `step` of an angle; return its value and angle."""
    while step > _SHARP:
        step *= 0.5
        for side in (angle - step, angle + step):
            other = _ratio(p, i, side)
            if other < value:
                value, angle = other, side
    return value, angle


@njit
def _ratio(p: Programme, i: int, angle: float) -> float:
    """How far a force is from a plane over what a unit of t moves it towards there."""
    x, y, z = _plane(p, i, np.cos(angle), np.sin(angle))
    f = p.forces[i]
    return (x * f[0] + y * f[1] + z * f[2]) / max(_asked(p, i, x, y, z), 1e-12)
