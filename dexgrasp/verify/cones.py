"""Forces within friction cones: the judge's own programmes, solved by clarabel and, through qpsolvers, by osqp.

A solver may stop short, so no answer rests on its word. The residual of Eq. 4 is bracketed: above by forces moved into
the cones, below by a separating wrench. A margin is that of forces whose balance is looked at. What is left open counts
as not shown.
"""

import warnings
from typing import NamedTuple

import numpy as np

from dexgrasp_env.arrays import Array

FORCE_BOUND = 1e5
"""Lower bounds hold for contact forces up to this many times f_min."""
_IMBALANCE = 1e-6  # of the total press: more than rounding


class Residual(NamedTuple):
    """Eq. 4 in the exact cone, bracketed.

    Attributes:
        upper: residual, N^2, of `forces`, which lie in the cones and press at least 1 N.
        lower: no forces up to `FORCE_BOUND` N have a smaller residual, N^2.
        forces: (N, 3) N.
    """

    upper: float
    lower: float
    forces: Array

    def closed(self, tolerance: float = 1e-6) -> bool | None:
        """Whether the least residual is below `tolerance`, N^2: True and False are proved, None is open."""
        return True if self.upper < tolerance else False if self.lower >= tolerance else None


def wrench_map(points: Array, centre: Array) -> Array:
    """Return (6, 3 N): forces at points (N, 3) -> wrench about `centre` (3,), torques over the points' rms radius."""
    radius = float(np.sqrt(((points - points.mean(0)) ** 2).sum(-1).mean()))
    arms = (points - centre) / (radius if radius > 1e-12 else 1.0)
    return np.array([[*e, *np.cross(arm, e)] for arm in arms for e in np.eye(3)]).T


def press_rows(normals: Array) -> Array:
    """Return (N, 3 N): forces -> how hard each presses against its normal (N, 3)."""
    rows = np.zeros((len(normals), len(normals), 3))
    rows[np.arange(len(normals)), np.arange(len(normals))] = -normals
    return rows.reshape(len(normals), -1)


def cone_rows(normals: Array, mu: float) -> Array:
    """Return (3 N, 3 N): forces -> (mu press, u, v) of each contact, which lies in a second-order cone."""
    rows = np.zeros((len(normals), 3, len(normals), 3))
    for i, n in enumerate(normals):
        across = np.cross(n, np.eye(3)[np.abs(n).argmin()])
        across /= np.linalg.norm(across)
        rows[i, :, i] = [-mu * n, across, np.cross(n, across)]
    return rows.reshape(3 * len(normals), -1)


def conic_residual(points: Array, normals: Array, mu: float) -> Residual:
    """Bracket the least value of Eq. 4 (f_min 1 N, torques over the rms radius) with the exact cone.

    Args:
        points: (N, 3) m.
        normals: (N, 3) unit, out of the object.
        mu: friction coefficient.
    """
    G, N = wrench_map(points, points.mean(0)), len(points)
    n = 3 * N
    # In (f, w) with w = G f: better conditioned than G^T G.
    x, _ = _minimise(
        np.diag(np.r_[np.zeros(n), np.full(6, 2.0)]), np.zeros(n + 6),
        equal=(np.c_[G, -np.eye(6)], np.zeros(6)),
        at_most=(np.c_[-press_rows(normals), np.zeros((N, 6))], np.full(N, -1.0)),
        cones=np.c_[cone_rows(normals, mu), np.zeros((n, 6))], tolerance=1e-12,
    )  # fmt: skip
    forces = _into_cones(np.nan_to_num(x[:n]).reshape(N, 3), normals, mu)
    wrench = G @ forces.ravel()
    return Residual(float(wrench @ wrench), _lower(G, wrench, normals, mu), forces)


def _into_cones(forces: Array, normals: Array, mu: float) -> Array:
    """Press harder until every force (N, 3) lies in its exact cone and presses at least 1 N."""
    press = -(forces * normals).sum(-1)
    sliding = np.linalg.norm(forces + press[:, None] * normals, axis=-1)
    need = np.maximum(1.0, sliding / mu * (1 + 1e-15))
    return forces - np.maximum(0.0, need - press)[:, None] * normals


def _lower(G: Array, wrench: Array, normals: Array, mu: float) -> float:
    """Bound |G f|^2 from below, by f's least component along `wrench` (6,)."""
    size = float(np.linalg.norm(wrench))
    if size == 0.0:
        return 0.0
    h = (G.T @ (wrench / size)).reshape(-1, 3)
    press = -(h * normals).sum(-1)
    least = press - mu * np.linalg.norm(h + press[:, None] * normals, axis=-1)
    return max(0.0, float(np.where(least >= 0, least, least * FORCE_BOUND).sum())) ** 2


def conic_margin(points: Array, normals: Array, mu: float) -> float | None:
    """Return the closure margin in the exact cone, N x max min_i (press_i - |f_t,i| / mu), or None.

    The maximum is over balanced forces whose presses sum to 1. None where no balanced forces press at all (all contacts
    on one face), or none are found.

    Args:
        points: (N, 3) m.
        normals: (N, 3) unit, out of the object.
        mu: friction coefficient.
    """
    G, N = wrench_map(points, points.mean(0)), len(points)
    rows, first = cone_rows(normals, mu) / mu, np.tile([1.0, 0.0, 0.0], N)
    x, _ = _minimise(
        np.zeros((3 * N + 1, 3 * N + 1)), np.r_[np.zeros(3 * N), -1.0],
        equal=(np.c_[np.r_[G, press_rows(normals).sum(0, keepdims=True)], np.zeros(7)], np.r_[np.zeros(6), 1.0]),
        cones=np.c_[rows, -first], tolerance=1e-10,
    )  # fmt: skip
    press, *across = (rows @ x[:-1]).reshape(N, 3).T
    total = press.sum()
    if not np.isfinite(x).all() or total < 1e-9 or np.linalg.norm(G @ x[:-1]) > _IMBALANCE * total:
        return None
    return N * float((press - np.hypot(*across)).min()) / float(total)


def pyramid_forces(points: Array, normals: Array, mu: float) -> Array:
    """Return forces (N, 3) N of Eq. 4 as in the paper (pyramids of Eq. 2, f_min 1 N); of 1 N each where osqp fails."""
    import qpsolvers
    from scipy.sparse import csc_matrix

    G, press = wrench_map(points, points.mean(0)), press_rows(normals)
    across = np.delete(cone_rows(normals, mu), np.s_[::3], axis=0)
    bound = mu * np.repeat(press, 2, axis=0)
    A = np.concatenate([-press, across - bound, -across - bound])
    b = np.r_[np.full(len(press), -1.0), np.zeros(2 * len(across))]
    problem = qpsolvers.Problem(csc_matrix(G.T @ G), np.zeros(G.shape[1]), csc_matrix(A), b)
    with warnings.catch_warnings():  # of what is returned as not found
        warnings.simplefilter("ignore")
        answer = qpsolvers.solve_problem(problem, "osqp", eps_abs=1e-9, eps_rel=1e-9, max_iter=400_000)
    return -normals if answer.x is None or not answer.found else answer.x.reshape(-1, 3)


def largest_push(
    G: Array, normals: Array, mu: float, torques: Array, push: tuple[Array, Array]
) -> float | None:
    """Return the largest s such that forces within cones and torques balance constant + s direction; None if none do.

    Args:
        G: (6, 3 N) forces -> wrench.
        normals: (N, 3) unit, out of the object.
        mu: friction coefficient.
        torques: (j, 3 N) forces -> joint torques over their limits.
        push: constant and direction, wrenches (6,).
    """
    n, (constant, direction) = G.shape[1], push
    limits = np.concatenate([torques, -torques])
    x, solved = _minimise(
        np.zeros((n + 1, n + 1)), np.r_[np.zeros(n), -1.0], equal=(np.c_[G, direction], -constant),
        at_most=(np.c_[limits, np.zeros(len(limits))], np.ones(len(limits))),
        cones=np.c_[cone_rows(normals, mu), np.zeros(n)], tolerance=1e-9,
    )  # fmt: skip
    return float(x[-1]) if solved else None


def _minimise(
    P: Array, q: Array, *, equal: tuple[Array, Array], cones: Array, tolerance: float,
    at_most: tuple[Array, Array] | None = None,
) -> tuple[Array, bool]:  # fmt: skip
    """Minimise x P x / 2 + q x with clarabel; three rows each of `cones` x lie in a second-order cone.

    Returns:
        x, and whether clarabel calls it solved, be it to reduced accuracy.
    """
    import clarabel
    from scipy.sparse import csc_matrix

    rows, bounds = at_most or (np.zeros((0, len(q))), np.zeros(0))
    kinds = [clarabel.ZeroConeT(len(equal[1]))]
    if len(bounds):
        kinds.append(clarabel.NonnegativeConeT(len(bounds)))
    kinds += [clarabel.SecondOrderConeT(3)] * (len(cones) // 3)
    A = csc_matrix(np.concatenate([equal[0], rows, -cones]))
    b = np.concatenate([equal[1], bounds, np.zeros(len(cones))])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    answer = clarabel.DefaultSolver(csc_matrix(P), q, A, b, kinds, settings).solve()
    status = clarabel.SolverStatus
    return np.array(answer.x), answer.status in (status.Solved, status.AlmostSolved)
