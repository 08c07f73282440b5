"""Forces that hold: they balance gravity, leave room for a disturbance, and stay within joint torques.

**Formulation.** A disturbance is any force on the object, through its centre of mass, up to D = disturbance
x m |g| (an acceleration in any direction). The contacts answer it with the smallest forces that do, df =
G^+ w, a linear answer: contact i moves by at most D s_i, s_i the largest singular value of its 3 x 3 block
of G^+. One set of forces f0 balances gravity exactly, and each f0_i keeps a distance of at least D s_i from
every face of its cone; then f0 + df lies in the cones for every such disturbance. Among those, f0 has the
least |f|^2: the gentlest squeeze that is provably firm enough. The cones are octagonal pyramids inside the
exact cones of mu / safety. Joint torques |J_i^T f_i| are kept within limits, by f0 as it is. All
constraints are linear: one small QP.

It is sufficient, not necessary: an answer other than the least one might resist more.
"""

from typing import NamedTuple

import numpy as np

from agents.physics.active_set import SOLVED, solve_qp
from agents.physics.checks import Numbers, check_array, check_contacts, check_positive, rms_radius
from agents.physics.cones import tangent_basis
from agents.physics.wrench import grasp_map
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError

FACES = 8
_BALANCE = 1e-6
"""Imbalance that counts as balanced, as a part of the weight."""
_STIFF = 1e7
"""Weight of the imbalance against |f|^2 in the QP: gravity is balanced to 1 part in this, roughly."""


class HoldingForces(NamedTuple):
    """Forces for a squeeze, and whether they hold."""

    forces: Array
    """(N, 3) contact forces on the object [N], world axes; where nothing holds, those that come nearest."""
    residual: float
    """|gravity + contact wrench| / (m |g|), torques over the contacts' rms radius; 0: balanced."""
    holds: bool
    """Gravity balanced, the room for the disturbance there, torques within their limits."""
    max_torque_fraction: float
    """Largest |joint torque| / limit; 0 without Jacobians."""
    reason: str
    """Why nothing holds ("" where it does)."""


def _faces(normals: Array, mu: float) -> Array:
    """Unit inward normals (N, FACES, 3) of the faces of pyramids inside the exact cones."""
    t1, t2 = tangent_basis(normals)
    angle = 2.0 * np.pi * (np.arange(FACES) + 0.5) / FACES
    reach = mu * np.cos(np.pi / FACES)
    u, v = np.cos(angle)[:, None], np.sin(angle)[:, None]
    rows = -reach * normals[:, None] - u * t1[:, None] - v * t2[:, None]
    return rows / np.sqrt(1.0 + reach * reach)


def _per_contact(rows: Array) -> Array:
    """Spread rows (N, R, 3), each on its contact's force, to (N R, 3 N)."""
    N, R, _ = rows.shape
    out = np.zeros((N * R, 3 * N))
    for i in range(N):
        out[R * i : R * i + R, 3 * i : 3 * i + 3] = rows[i]
    return out


def _torque_rows(jacobians: Numbers, limits: Numbers, N: int) -> tuple[Array, Array]:
    """Rows and bounds of +-J^T f >= -limit, and the (N, joints) limits."""
    J = check_array("jacobians", jacobians, (N, 3, None))
    try:
        tau = np.broadcast_to(np.asarray(limits, dtype=float), (N, J.shape[2]))
    except ValueError:
        raise InputError(
            f"torque_limits must be one number, ({J.shape[2]},) or ({N}, {J.shape[2]})"
        ) from None
    if not (np.isfinite(tau).all() and (tau > 0).all()):
        raise InputError("torque_limits must be finite and above 0")
    JT = J.transpose(0, 2, 1) / tau[..., None]
    rows = np.concatenate([_per_contact(JT), -_per_contact(JT)])
    return rows, -np.ones(len(rows))


class _Problem(NamedTuple):
    G: Array
    gravity: Array  # wrench (6,)
    weight: float
    cone: Array
    room: Array  # distance each cone row must keep
    press: Array
    f_min: float
    torque: Array
    torque_bound: Array


def _solve(problem: _Problem, disturbed: bool, limited: bool) -> tuple[Array, bool]:
    """The least forces (3 N,) in the cones that balance gravity, and whether they do."""
    p = problem
    n = p.G.shape[1]
    keep = (np.abs(p.torque) > 1e-12).any(1) & limited
    A = np.concatenate([p.cone, p.press, p.torque[keep]])
    room = p.room if disturbed else np.zeros_like(p.room)
    b = np.concatenate([room, np.full(len(p.press), p.f_min), p.torque_bound[keep]])
    x, multipliers, shift = np.zeros(n), np.zeros(len(b)), np.zeros(6)
    # the imbalance is weighed, then taken out by multipliers: there is an answer even where nothing holds
    H = np.eye(n) + _STIFF * p.G.T @ p.G
    for _ in range(20):
        if solve_qp(H, _STIFF * p.G.T @ (p.gravity + shift), A, b, x, multipliers) != SOLVED:
            return np.zeros(n), False
        wrench = p.G @ x + p.gravity
        if np.sqrt(wrench @ wrench) < 0.1 * _BALANCE * p.weight:
            break
        shift = shift + wrench
    return x, bool(np.sqrt(wrench @ wrench) < _BALANCE * p.weight)


def _reason(problem: _Problem, resists: bool) -> str:
    """Say which demand, taken away, makes the rest possible."""
    if not _solve(problem, False, False)[1]:
        return "no forces within the friction cones balance gravity at these contacts"
    if not resists:
        return "the contacts cannot answer a force in some direction (they lie on a line, or are too few)"
    if not _solve(problem, True, False)[1]:
        return "the friction cones leave no room for the disturbance, however hard the squeeze"
    if not _solve(problem, False, True)[1]:
        return "joint torque limits are too small to balance gravity"
    return "joint torque limits are too small for the squeeze that the disturbance needs"


def holding_forces(
    points: Numbers,
    normals: Numbers,
    mu: float,
    mass: float,
    com: Numbers,
    gravity: Numbers = (0.0, 0.0, -9.81),
    jacobians: Numbers = None,
    torque_limits: Numbers = None,
    safety: float = 1.5,
    f_min: float = 0.1,
    disturbance: float = 0.5,
    explain: bool = True,
) -> HoldingForces:
    """Return the gentlest contact forces that hold an object (the module's text says what that means).

    Args:
        points: (N, 3) metres, world axes. normals: (N, 3) unit, out of the object.
        mu: friction coefficient; the forces use mu / safety.
        mass: kilograms. com: (3,) centre of mass [m]. gravity: (3,) [m/s^2].
        jacobians: (N, 3, joints) of each contact point by its finger's joints, world axes, or None for no
            limits.
        torque_limits: [Nm], one number, (joints,) or (N, joints); needed with `jacobians`.
        safety: at least 1, divides mu.
        f_min: least pressing force of each contact [N].
        disturbance: the acceleration to resist in every direction, in multiples of gravity; 0 for gravity
            alone.
        explain: whether to find out why nothing holds, which costs up to four more programmes.

    Raises:
        InputError: shapes, NaN, ranges, or one of `jacobians` and `torque_limits` without the other.
    """
    points, normals = check_contacts(points, normals)
    N = len(points)
    mu, mass, f_min = check_positive("mu", mu), check_positive("mass", mass), check_positive("f_min", f_min)
    if N == 0 or check_positive("safety", safety) < 1 or not (np.isfinite(disturbance) and disturbance >= 0):
        raise InputError("at least one contact, safety >= 1 and disturbance >= 0 are needed")
    if (jacobians is None) != (torque_limits is None):
        raise InputError("give both jacobians and torque_limits, or neither")
    com, g = check_array("com", com, (3,)), check_array("gravity", gravity, (3,))
    G = grasp_map(points, com, rms_radius(points))
    weight = max(mass * float(np.sqrt(g @ g)), 1e-9)
    answer = np.linalg.pinv(G, rcond=1e-9)[:, :3]
    resists = disturbance == 0 or bool(np.abs(G @ answer - np.eye(6, 3)).max() < 1e-6)
    shares = np.linalg.norm(answer.reshape(N, 3, 3), ord=2, axis=(1, 2))
    room = np.repeat(disturbance * weight * shares, FACES)
    torque, bound = np.zeros((0, 3 * N)), np.zeros(0)
    if jacobians is not None:
        torque, bound = _torque_rows(jacobians, torque_limits, N)
    problem = _Problem(
        G,
        np.r_[mass * g, 0, 0, 0],
        weight,
        _per_contact(_faces(normals, mu / safety)),
        room,
        -_per_contact(normals[:, None]),
        f_min,
        torque,
        bound,
    )
    forces, found = _solve(problem, True, True)
    holds = found and resists
    if not found:
        forces = _solve(problem, False, True)[0]
    wrench = G @ forces + problem.gravity
    fraction = float(np.abs(torque @ forces).max()) if len(torque) else 0.0
    reason = "" if holds else _reason(problem, resists) if explain else "not explained"
    return HoldingForces(
        forces.reshape(N, 3), float(np.sqrt(wrench @ wrench)) / weight, holds, fraction, reason
    )
