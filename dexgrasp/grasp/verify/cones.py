"""Forces within friction cones: the judge's own programmes, solved by clarabel and, through qpsolvers, by osqp.

A solver may stop short, so no answer rests on its word. The residual of Eq. 4 is that of forces moved into the cones, a
margin that of forces whose balance is looked at. What is left open counts as not shown.
"""

import warnings

import numpy as np

from dexgrasp_env.arrays import Array


def wrench_map(points: Array, centre: Array, normals: Array | None = None, torsion: float = 0.0) -> Array:
    """Return (6, c N): forces at points (N, 3) -> wrench about `centre` (3,), torques over the points' rms radius.

    Of soft contacts each force has a fourth part: what it turns about its normal (N, 3) with, over `torsion`, m.
    """
    radius = np.sqrt(((points - points.mean(0)) ** 2).sum(-1).mean())
    radius = radius if radius > 1e-12 else 1.0
    columns = [[[*e, *np.cross(arm, e)] for e in np.eye(3)] for arm in (points - centre) / radius]
    if normals is not None and torsion:
        columns = [
            [*own, [0.0, 0.0, 0.0, *(torsion / radius * n)]] for own, n in zip(columns, normals, strict=True)
        ]
    return np.concatenate(columns).T


def press_rows(normals: Array, parts: int = 3) -> Array:
    """Return (N, c N): forces of c parts -> how hard each presses against its normal (N, 3)."""
    rows = np.zeros((len(normals), len(normals), parts))
    rows[np.arange(len(normals)), np.arange(len(normals)), :3] = -normals
    return rows.reshape(len(normals), -1)


def cone_rows(normals: Array, mu: float, parts: int = 3) -> Array:
    """Return (c N, c N): forces -> (mu press, u, v and what turns) of each contact, in a second-order cone."""
    rows = np.zeros((len(normals), parts, len(normals), parts))
    for i, n in enumerate(normals):
        across = np.cross(n, np.eye(3)[np.abs(n).argmin()])
        across /= np.linalg.norm(across)
        rows[i, :3, i, :3] = [-mu * n, across, np.cross(n, across)]
        rows[i, 3:, i, 3:] = np.eye(parts - 3)
    return rows.reshape(parts * len(normals), -1)


def slides(forces: Array, normals: Array) -> tuple[Array, Array]:
    """Return how hard forces (..., N, c) press, and what friction they ask for, N, (..., N) each."""
    press = -(forces[..., :3] * normals).sum(-1)
    across = forces.copy()
    across[..., :3] += press[..., None] * normals
    return press, np.linalg.norm(across, axis=-1)


def conic_residual(points: Array, normals: Array, mu: float) -> float:
    """Return a residual of Eq. 4, N^2, that forces in the exact cones have: the least, or more where clarabel fails.

    Args:
        points: (N, 3) m.
        normals: (N, 3) unit, out of the object.
        mu: friction coefficient.
    """
    G, N = wrench_map(points, points.mean(0)), len(points)
    n = 3 * N
    # In (f, w) with w = G f: better conditioned than G^T G.
    x, _ = _minimise(
        np.r_[np.zeros(n), np.full(6, 2.0)], np.zeros(n + 6), equal=(np.c_[G, -np.eye(6)], np.zeros(6)),
        at_most=(np.c_[-press_rows(normals), np.zeros((N, 6))], np.full(N, -1.0)),
        cones=np.c_[cone_rows(normals, mu), np.zeros((n, 6))], tolerance=1e-12,
    )  # fmt: skip
    forces = np.nan_to_num(x[:n]).reshape(N, 3)
    press, sliding = slides(forces, normals)
    need = np.maximum(1.0, sliding / mu * (1 + 1e-15))  # harder until each lies in its cone
    forces -= np.maximum(0.0, need - press)[:, None] * normals
    wrench = G @ forces.ravel()
    return float(wrench @ wrench)


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


def conic_margin(points: Array, normals: Array, mu: float, torsion: float = 0.0) -> float | None:
    """Return the closure margin in the exact cone, N x max min_i (press_i - |f_t,i| / mu), or None.

    The maximum is over balanced forces whose presses sum to 1. None where no balanced forces press at all (all contacts
    on one face), or none are found, or where contacts leave some wrench free, as two points do.

    Args:
        points: (N, 3) m.
        normals: (N, 3) unit, out of the object.
        mu: friction coefficient.
        torsion: radius of soft contacts, m; 0: points.
    """
    G, N, parts = wrench_map(points, points.mean(0), normals, torsion), len(points), 4 if torsion else 3
    if np.linalg.matrix_rank(G, tol=1e-4) < 6:  # least singular value of a grasp matrix of rank 6
        return None
    rows, first = cone_rows(normals, mu, parts) / mu, np.tile(np.eye(parts)[0], N)
    n = parts * N
    x, _ = _minimise(
        np.zeros(n + 1), np.r_[np.zeros(n), -1.0],
        equal=(np.c_[np.r_[G, press_rows(normals, parts).sum(0)[None]], np.zeros(7)], np.r_[np.zeros(6), 1.0]),
        cones=np.c_[rows, -first], tolerance=1e-10, size=parts,
    )  # fmt: skip
    press, *across = (rows @ x[:-1]).reshape(N, parts).T
    total = press.sum()
    # of the total press: more than rounding
    if not np.isfinite(x).all() or total < 1e-9 or np.linalg.norm(G @ x[:-1]) > 1e-6 * total:
        return None
    return N * (press - np.linalg.norm(across, axis=0)).min() / total


def largest_push(
    G: Array, normals: Array, mu: float, torques: Array, push: tuple[Array, Array]
) -> float | None:
    """Return the largest s such that forces within cones and torques balance constant + s direction; None if none do.

    Args:
        G: (6, c N) forces -> wrench.
        normals: (N, 3) unit, out of the object.
        mu: friction coefficient.
        torques: (j, c N) forces -> joint torques over their limits.
        push: constant and direction, wrenches (6,).
    """
    n, parts, (constant, direction) = G.shape[1], G.shape[1] // len(normals), push
    limits = np.concatenate([torques, -torques])
    x, solved = _minimise(
        np.zeros(n + 1), np.r_[np.zeros(n), -1.0], equal=(np.c_[G, direction], -constant),
        at_most=(np.c_[limits, np.zeros(len(limits))], np.ones(len(limits))),
        cones=np.c_[cone_rows(normals, mu, parts), np.zeros(n)], tolerance=1e-9, size=parts,
    )  # fmt: skip
    return float(x[-1]) if solved else None


def _minimise(
    p: Array, q: Array, *, equal: tuple[Array, Array], cones: Array, tolerance: float,
    at_most: tuple[Array, Array] | None = None, size: int = 3,
) -> tuple[Array, bool]:  # fmt: skip
    """Minimise sum p x^2 / 2 + q x with clarabel; `size` rows each of `cones` x lie in a second-order cone.

    Returns:
        x, and whether clarabel calls it solved, be it to reduced accuracy.
    """
    import clarabel
    from scipy.sparse import csc_matrix, diags_array

    rows, bounds = at_most or (np.zeros((0, len(q))), np.zeros(0))
    kinds = [clarabel.ZeroConeT(len(equal[1]))]
    if len(bounds):
        kinds.append(clarabel.NonnegativeConeT(len(bounds)))
    kinds += [clarabel.SecondOrderConeT(size)] * (len(cones) // size)
    A = csc_matrix(np.concatenate([equal[0], rows, -cones]))
    b = np.concatenate([equal[1], bounds, np.zeros(len(cones))])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    answer = clarabel.DefaultSolver(diags_array(p, format="csc"), q, A, b, kinds, settings).solve()
    status = clarabel.SolverStatus
    return np.array(answer.x), answer.status in (status.Solved, status.AlmostSolved)
