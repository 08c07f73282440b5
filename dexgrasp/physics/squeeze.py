"""The squeeze that bears the largest push: a linear programme in four variables, exact by cutting planes.

Three contacts that are not on a line balance any wrench, and all forces that do are f = s f_g + N x: f_g balances
gravity, s is the share of it that is borne, and x are the three internal forces along the sides of the triangle. A
push w, any force through the centre of mass, is answered by the forces of least norm; contact i answers with -B_i w.
f + df lies in the exact cone of contact i for every push up to D x weight if and only if for every plane that touches
the cone, with inward normal a,

    a . f_i >= D x weight x |B_i^T a|.

The firmest squeeze is the largest D over x with s = 1, within joint torque limits, or, where that would be negative,
the largest s with D = 0. Of a push beyond `RESERVED` weights the joints must be able to answer the excess: those that
squeeze with all they have give way under it long before the cones do. Planes are added where the answer breaks them
until it does not.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from dexgrasp.physics.active_set import SOLVED, solve_qp
from dexgrasp.physics.checks import Numbers, check_array, check_contacts, check_positive
from dexgrasp.physics.cones import basis_of
from dexgrasp.physics.simplex import maximise_last
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError

FACES = 12
"""Planes of each cone that a programme starts with."""
ROUNDS = 8
"""Rounds of cutting planes at most; two or three are enough as a rule."""
RESERVED = 1.0
"""Weights: what a push has beyond this, the joints keep the torque to answer. What is heavy is squeezed with all."""
_CUTS = 3 * ROUNDS
_COARSE = 8  # planes of each cone in an estimate
_TOLERANCE = 1e-4  # of D: what cutting planes may leave
_FLAT = 2e-3  # height of the triangle over its longest side, below which contacts count as lying on a line
_REGULARISER = 1e-7  # weight of |x|^2: the programme is linear, its solver quadratic
_PUSH, _SHARE = 3, 4  # columns of D and s, after the three internal forces


class Squeeze(NamedTuple):
    """Forces of a squeeze, and what they bear."""

    forces: Array
    """(3, 3) N on the object, world axes."""
    push: float
    """D: largest force in any direction that they bear, in weights; 0 where they bear gravity alone, or less."""
    share: float
    """Of the weight that they balance: 1, or less where the joints or the cones allow no more; 0: nothing holds."""

    @property
    def load(self) -> float:
        """Of the weight, how much is borne: 1 + D, or the share that is balanced."""
        return self.share + self.push


@njit(cache=True, error_model="numpy")
def balance(points: Array, centre: Array, gravity: Array, N: Array, B: Array, f_g: Array) -> bool:
    """Write internal forces (9, 3), answers to a force (9, 3) and forces against gravity (9,); False on a line."""
    size, area = 0.0, np.zeros(3)
    for side in range(3):
        i, j = (0, 1) if side == 0 else (0, 2) if side == 1 else (1, 2)
        d = points[j] - points[i]
        length = np.sqrt((d * d).sum())
        size = max(size, length)
        N[:, side] = 0.0
        for k in range(3):
            N[3 * i + k, side], N[3 * j + k, side] = d[k] / length, -d[k] / length
    area = np.cross(points[1] - points[0], points[2] - points[0])
    if not np.sqrt((area * area).sum()) > _FLAT * size * size:
        return False
    # About the contacts' middle forces and torques come apart: a force w and its torque t are answered by
    # w / 3 + (M^-1 t) x r_i with M = sum |r_i|^2 I - r_i r_i^T.
    r, M = np.empty((3, 3)), np.zeros((3, 3))
    for k in range(3):
        middle = (points[0, k] + points[1, k] + points[2, k]) / 3.0
        for i in range(3):
            r[i, k] = points[i, k] - middle
        area[k] = centre[k] - middle
    for i in range(3):
        for k in range(3):
            for c in range(3):
                M[k, k] += r[i, c] * r[i, c]
                M[k, c] -= r[i, k] * r[i, c]
    _invert(M)
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for i in range(3):
            for k in range(3):
                # torque of a unit force along the axis: area x e = (.., area_v at u, -area_u at v)
                p, q = (k + 1) % 3, (k + 2) % 3
                turn_p = M[p, u] * area[v] - M[p, v] * area[u]
                turn_q = M[q, u] * area[v] - M[q, v] * area[u]
                B[3 * i + k, axis] = turn_p * r[i, q] - turn_q * r[i, p]
            B[3 * i + axis, axis] += 1.0 / 3.0
    f_g[:] = -(B @ gravity)
    return True


@njit(cache=True, error_model="numpy")
def _invert(M: Array) -> None:
    """Invert a symmetric matrix (3, 3) in place."""
    a, b, c, d, e, f = M[0, 0], M[0, 1], M[0, 2], M[1, 1], M[1, 2], M[2, 2]
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    det = a * A + b * B + c * C
    M[0, 0], M[0, 1], M[0, 2] = A / det, B / det, C / det
    M[1, 1], M[1, 2], M[2, 2] = (a * f - c * c) / det, (b * c - a * e) / det, (a * d - b * b) / det
    M[1, 0], M[2, 0], M[2, 1] = M[0, 1], M[0, 2], M[1, 2]


@njit(cache=True, error_model="numpy")
def _tangents(n: Array, t1: Array, t2: Array) -> None:
    t1[0], t1[1], t1[2], t2[0], t2[1], t2[2] = basis_of(n[0], n[1], n[2])


@njit(cache=True, error_model="numpy")
def _plane(normal: Array, t1: Array, t2: Array, mu: float, angle: float, block: Array, a: Array) -> float:
    """Write the inward normal (3,) of the plane that touches a cone at an angle; return |block^T a|."""
    scale, c, s = 1.0 / np.sqrt(1.0 + mu * mu), np.cos(angle), np.sin(angle)
    size = 0.0
    for k in range(3):
        a[k] = scale * (-mu * normal[k] - c * t1[k] - s * t2[k])
    for q in range(3):
        h = block[0, q] * a[0] + block[1, q] * a[1] + block[2, q] * a[2]
        size += h * h
    return np.sqrt(size)


@njit(cache=True, error_model="numpy")
def _cone_row(i: int, a: Array, answer: float, N: Array, f_g: Array, row: Array) -> None:
    """Write a plane's row (5,): a . f_i - D answer >= 0 in the variables (x, D, s)."""
    row[_SHARE] = a[0] * f_g[3 * i] + a[1] * f_g[3 * i + 1] + a[2] * f_g[3 * i + 2]
    row[_PUSH] = -answer
    for q in range(3):
        row[q] = a[0] * N[3 * i, q] + a[1] * N[3 * i + 1, q] + a[2] * N[3 * i + 2, q]


@njit(cache=True, error_model="numpy")
def _torque_rows(
    J: Array, limit: Array, N: Array, B: Array, f_g: Array, kinds: int, A: Array, b: Array
) -> int:
    """Write rows +-J^T f / limit >= -1; return how many.

    With two `kinds`, also rows less (D - RESERVED) |J^T B| / limit, what the joint answers to a push beyond `RESERVED`.
    """
    r, g = 0, np.empty(3)
    for i in range(3):
        for j in range(J.shape[2]):
            g[:] = J[i, :, j] / limit[j]
            if g[0] == 0.0 and g[1] == 0.0 and g[2] == 0.0:
                continue
            answer = 0.0
            for q in range(3):
                h = g[0] * B[3 * i, q] + g[1] * B[3 * i + 1, q] + g[2] * B[3 * i + 2, q]
                answer += h * h
            answer = np.sqrt(answer)
            for sign in (-1.0, 1.0):
                for kind in range(kinds):
                    for q in range(3):
                        A[r, q] = sign * (
                            g[0] * N[3 * i, q] + g[1] * N[3 * i + 1, q] + g[2] * N[3 * i + 2, q]
                        )
                    A[r, _PUSH] = -kind * answer
                    A[r, _SHARE] = sign * (g[0] * f_g[3 * i] + g[1] * f_g[3 * i + 1] + g[2] * f_g[3 * i + 2])
                    b[r] = -1.0 - kind * RESERVED * answer
                    r += 1
    return r


@njit(cache=True, error_model="numpy")
def _maximise(A: Array, b: Array, rows: int, column: int, fixed: float, most: float, y: Array) -> bool:
    """Maximise variable `column` (D or s) of y (5,), at most `most`; the other of the two is `fixed`."""
    other = _PUSH + _SHARE - column
    C, c = np.empty((rows + 1, 4)), np.empty(rows + 1)
    for r in range(rows):
        for q in range(3):
            C[r, q] = A[r, q]
        C[r, 3], c[r] = A[r, column], b[r] - A[r, other] * fixed
    C[rows] = 0.0
    C[rows, 3], c[rows] = -1.0, -most
    H, g, z, multipliers = _REGULARISER * np.eye(4), np.zeros(4), np.zeros(4), np.zeros(rows + 1)
    g[3] = -1.0
    if solve_qp(H, g, C, c, z, multipliers) != SOLVED:
        return False
    y[:3], y[column], y[other] = z[:3], z[3], fixed
    return True


@njit(cache=True, error_model="numpy")
def _borne(f: Array, normal: Array, t1: Array, t2: Array, mu: float, block: Array) -> tuple[float, float]:
    """The largest D (weights) that a contact's force (3,) bears, and the angle of the plane that says so.

    `block` (3, 3) is the contact's answer to a push of one weight.
    """
    a = np.empty(3)
    step, best, at = 2.0 * np.pi / 144, np.inf, 0.0
    for k in range(144):
        value = _ratio(f, normal, t1, t2, mu, block, k * step, a)
        if value < best:
            best, at = value, k * step
    low, high = at - step, at + step
    golden = 0.5 * (np.sqrt(5.0) - 1.0)
    for _ in range(40):
        m1, m2 = high - golden * (high - low), low + golden * (high - low)
        if _ratio(f, normal, t1, t2, mu, block, m1, a) < _ratio(f, normal, t1, t2, mu, block, m2, a):
            high = m2
        else:
            low = m1
    middle = 0.5 * (low + high)
    value = _ratio(f, normal, t1, t2, mu, block, middle, a)
    return (value, middle) if value < best else (best, at)


@njit(cache=True, error_model="numpy")
def _ratio(
    f: Array, normal: Array, t1: Array, t2: Array, mu: float, block: Array, angle: float, a: Array
) -> float:
    """How far f is from a plane of the cone over what a push of one weight moves it towards there."""
    answer = _plane(normal, t1, t2, mu, angle, block, a)
    return (a[0] * f[0] + a[1] * f[1] + a[2] * f[2]) / max(answer, 1e-12)


@njit(cache=True, error_model="numpy")
def squeeze_kernel(
    points: Array, normals: Array, centre: Array, gravity: Array, mu: Array, press: float, J: Array, limit: Array,
    most: float, rounds: int, forces: Array,
) -> tuple[float, float]:  # fmt: skip
    """Write the firmest forces and return the D that they bear, and the share of gravity they balance; no checks.

    Args:
        points: (3, 3) m. normals: (3, 3) unit, out of the object. centre: (3,) m, centre of mass.
        gravity: (3,) N.
        mu: (3,) friction coefficients. press: N, least of each contact.
        J: (3, 3, joints) of the contact points. limit: (joints,) Nm.
        most: D beyond which nothing is gained.
        rounds: of cutting planes; 0 is an estimate that is at most a few percent too high.
        forces: (3, 3), written.
    """
    N, B, f_g = np.empty((9, 3)), np.empty((9, 3)), np.empty(9)
    forces[:] = 0.0
    if not balance(points, centre, gravity, N, B, f_g):
        return 0.0, 0.0
    weight = np.sqrt((gravity * gravity).sum())
    B *= weight
    size = 3 * FACES + 3 + 12 * J.shape[2] + _CUTS
    A, b = np.zeros((size, 5)), np.zeros(size)
    T, a = np.empty((3, 2, 3)), np.empty(3)
    rows = 0
    for i in range(3):
        _tangents(normals[i], T[i, 0], T[i, 1])
        block = B[3 * i : 3 * i + 3]
        for k in range(FACES):
            answer = _plane(normals[i], T[i, 0], T[i, 1], mu[i], 2.0 * np.pi * k / FACES, block, a)
            _cone_row(i, a, answer, N, f_g, A[rows])
            rows += 1
        _cone_row(i, -normals[i], 0.0, N, f_g, A[rows])
        b[rows] = press
        rows += 1
    rows += _torque_rows(J, limit, N, B, f_g, 2, A[rows:], b[rows:])
    y, column, fixed, top = np.zeros(5), _PUSH, 1.0, most
    value = 0.0
    for turn in range(rounds + 1):
        if column == _PUSH and (not _maximise(A, b, rows, column, fixed, top, y) or y[_PUSH] < 0.0):
            column, fixed, top = _SHARE, 0.0, 1.0
        if column == _SHARE and not _maximise(A, b, rows, column, fixed, top, y):
            return 0.0, 0.0
        for i in range(3):
            for k in range(3):
                c = 3 * i + k
                forces[i, k] = y[_SHARE] * f_g[c] + N[c, 0] * y[0] + N[c, 1] * y[1] + N[c, 2] * y[2]
        if turn == rounds and rounds == 0:
            return y[_PUSH], y[_SHARE]
        value, done = np.inf, True
        for i in range(3):
            block = B[3 * i : 3 * i + 3]
            borne, angle = _borne(forces[i], normals[i], T[i, 0], T[i, 1], mu[i], block)
            value = min(value, borne)
            if borne < y[_PUSH] - _TOLERANCE and turn < rounds:
                done = False
                answer = _plane(normals[i], T[i, 0], T[i, 1], mu[i], angle, block, a)
                _cone_row(i, a, answer, N, f_g, A[rows])
                rows += 1
        if done:
            break
    return max(min(value, y[_PUSH]), 0.0), y[_SHARE]


class Room(NamedTuple):
    """Room that `squeeze_estimate` works in: estimates are made by the thousand."""

    N: Array  # (9, 3)
    B: Array  # (9, 3)
    f_g: Array  # (9,)
    A: Array  # (rows, 5)
    C: Array  # (rows, 4)
    b: Array  # (rows,)


@njit(cache=True, error_model="numpy")
def empty_room(joints: int) -> Room:
    """Return room for contacts that `joints` joints press."""
    size = 3 * _COARSE + 6 * joints
    A, C = np.empty((size, 5)), np.empty((size, 4))
    return Room(np.empty((9, 3)), np.empty((9, 3)), np.empty(9), A, C, np.empty(size))


@njit(cache=True, error_model="numpy")
def squeeze_estimate(
    points: Array, normals: Array, centre: Array, gravity: Array, mu: Array, J: Array, limit: Array, most: float,
    room: Room,
) -> float:  # fmt: skip
    """Return the load of the firmest squeeze, at most a tenth too high: cones have eight planes, and none is added.

    Args are those of `squeeze_kernel`.
    """
    N, B, f_g, A, C, b = room
    if not balance(points, centre, gravity, N, B, f_g):
        return 0.0
    B *= np.sqrt((gravity * gravity).sum())
    a, t1, t2, rows = np.empty(3), np.empty(3), np.empty(3), 0
    for i in range(3):
        _tangents(normals[i], t1, t2)
        block = B[3 * i : 3 * i + 3]
        for k in range(_COARSE):
            answer = _plane(normals[i], t1, t2, mu[i], 2.0 * np.pi * k / _COARSE, block, a)
            _cone_row(i, a, answer, N, f_g, A[rows])
            b[rows] = 0.0
            rows += 1
    rows += _torque_rows(J, limit, N, B, f_g, 1, A[rows:], b[rows:])
    z = np.empty(4)
    for r in range(rows):
        for q in range(4):
            C[r, q] = A[r, q]
        b[r] -= A[r, _SHARE]
    if maximise_last(C, b, rows, most, z) and z[3] >= 0.0:
        return 1.0 + z[3]
    for r in range(rows):
        C[r, 3] = A[r, _SHARE]
        b[r] += A[r, _SHARE]
    return max(z[3], 0.0) if maximise_last(C, b, rows, 1.0, z) else 0.0


def _check(
    points: Numbers, normals: Numbers, mass: float, com: Numbers, gravity: Numbers
) -> tuple[Array, Array, Array, Array]:
    points, normals = check_contacts(points, normals, 3)
    down = check_positive("mass", mass) * check_array("gravity", gravity, (3,))
    if not (down * down).sum() > 0.0:
        raise InputError("gravity must not be zero: pushes are measured in weights")
    return points, normals, check_array("com", com, (3,)), down


def _check_joints(jacobians: Numbers, torque_limits: Numbers) -> tuple[Array, Array]:
    J = check_array("jacobians", jacobians, (3, 3, None))
    try:
        limit = np.ascontiguousarray(np.broadcast_to(np.asarray(torque_limits, dtype=float), (J.shape[2],)))
    except (TypeError, ValueError):
        raise InputError(f"torque_limits must be one number or ({J.shape[2]},)") from None
    if not (np.isfinite(limit).all() and (limit > 0).all()):
        raise InputError("torque_limits must be finite and above 0")
    return J, limit


def firmest_squeeze(
    points: Numbers, normals: Numbers, mu: Numbers, mass: float, com: Numbers, jacobians: Numbers,
    torque_limits: Numbers, press: float = 0.0, gravity: Numbers = (0.0, 0.0, -9.81), most: float = 10.0,
) -> Squeeze:  # fmt: skip
    """Return the forces of three contacts that bear the largest push in any direction.

    Args:
        points: (3, 3) m, world axes. normals: (3, 3) unit, out of the object.
        mu: friction coefficient, one or one a contact.
        mass: kg. com: (3,) m, centre of mass. gravity: (3,) m/s^2.
        jacobians: (3, 3, joints) of each contact point by its finger's joints.
        torque_limits: Nm, one number or (joints,).
        press: N that each contact presses with at least.
        most: push, in weights, beyond which the squeeze need not be firmer.

    Raises:
        InputError: wrong shapes, NaN, or values out of range.
    """
    points, normals, centre, down = _check(points, normals, mass, com, gravity)
    friction = check_array("mu", np.broadcast_to(np.asarray(mu, dtype=float), (3,)), (3,))
    if not (friction > 0.0).all():
        raise InputError(f"mu must be above 0, got {mu!r}")
    J, limit = _check_joints(jacobians, torque_limits)
    forces = np.empty((3, 3))
    most = check_positive("most", most)
    press = float(press)
    push, share = squeeze_kernel(
        points, normals, centre, down, friction, press, J, limit, most, ROUNDS, forces
    )
    return Squeeze(forces, float(push), float(share))
