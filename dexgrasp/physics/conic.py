"""The exact cone (Eq. 1) to high accuracy, for verification: answers with proof.

clarabel solves the second-order cone programmes; in a few percent of cases it stops short of "Solved", so
no answer rests on its word. The residual is always bracketed: above by forces moved into the cones, below
by a separating wrench. Where the bracket stays open, a second method closes it: cutting planes on an outer
pyramid, solved by the active-set QP of this package.
"""

from typing import Any, NamedTuple

import numpy as np

from dexgrasp.physics.active_set import SOLVED, solve_qp
from dexgrasp.physics.checks import Numbers, check_array, check_contacts, check_positive, rms_radius
from dexgrasp.physics.cones import tangent_basis
from dexgrasp.physics.wrench import grasp_map
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError

FORCE_BOUND = 1e5
"""Lower bounds hold for contact forces up to this many times f_min."""


class ConicResidual(NamedTuple):
    """Eq. 4 in the exact cone, bracketed."""

    upper: float
    """Residual [N^2] of `forces`, which lie in the cones and press at least f_min."""
    lower: float
    """No forces up to FORCE_BOUND f_min have a smaller residual [N^2]."""
    forces: Array
    """(N, 3) [N]."""
    method: str
    """"clarabel" or "cutting planes"."""

    def closed(self, tolerance: float = 1e-6) -> bool | None:
        """Whether the least residual is below `tolerance` [N^2]: True and False are proved, None is open."""
        return True if self.upper < tolerance else False if self.lower >= tolerance else None


def into_cones(forces: Array, normals: Array, mu: float, f_min: float) -> Array:
    """Return forces (N, 3) pressed harder until they lie in the exact cones and press at least f_min."""
    press = -(forces * normals).sum(-1)
    tangent = forces + press[:, None] * normals
    need = np.maximum(f_min, np.sqrt((tangent**2).sum(-1)) / mu * (1 + 1e-15))
    return forces - np.maximum(0.0, need - press)[:, None] * normals


def _lower(G: Array, wrench: Array, normals: Array, mu: float, f_min: float) -> float:
    """Bound |G f|^2 from below, by f's least component along `wrench`."""
    size = float(np.sqrt(wrench @ wrench))
    if size == 0.0:
        return 0.0
    h = (G.T @ (wrench / size)).reshape(-1, 3)
    press = -(h * normals).sum(-1)
    least = press - mu * np.sqrt(((h + press[:, None] * normals) ** 2).sum(-1))
    total = f_min * np.where(least >= 0, least, least * FORCE_BOUND).sum()
    return max(0.0, float(total)) ** 2


def _bracket(G: Array, forces: Array, normals: Array, mu: float, f_min: float, method: str) -> ConicResidual:
    forces = into_cones(forces.reshape(-1, 3), normals, mu, f_min)
    wrench = G @ forces.ravel()
    return ConicResidual(float(wrench @ wrench), _lower(G, wrench, normals, mu, f_min), forces, method)


def _cone_rows(normals: Array, mu: float) -> Array:
    """Rows (3 N, 3 N): (mu press, u, v) of each contact, which must lie in a second-order cone."""
    t1, t2 = tangent_basis(normals)
    rows = np.zeros((3 * len(normals), 3 * len(normals)))
    for i, n in enumerate(normals):
        rows[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = [-mu * n, t1[i], t2[i]]
    return rows


def _clarabel(
    P: Array, q: Array, A: Array, b: Array, cones: list[Any], tolerance: float
) -> tuple[Array, bool]:
    import clarabel
    from scipy.sparse import csc_matrix

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    solution = clarabel.DefaultSolver(csc_matrix(P), q, csc_matrix(A), b, cones, settings).solve()
    return np.array(solution.x), solution.status == clarabel.SolverStatus.Solved


def _conic_qp(G: Array, normals: Array, mu: float, f_min: float) -> Array:
    """Forces (3 N,) of the cone programme in (f, w), w = G f: better conditioned than G^T G."""
    import clarabel

    N, n = len(normals), 3 * len(normals)
    P = np.diag(np.r_[np.zeros(n), np.full(6, 2.0)])
    press = np.zeros((N, n))
    for i in range(N):
        press[i, 3 * i : 3 * i + 3] = normals[i]
    A = np.block([[G, -np.eye(6)], [press, np.zeros((N, 6))], [-_cone_rows(normals, mu), np.zeros((n, 6))]])
    b = np.r_[np.zeros(6), np.full(N, -f_min), np.zeros(n)]
    cones = [clarabel.ZeroConeT(6), clarabel.NonnegativeConeT(N)] + [clarabel.SecondOrderConeT(3)] * N
    return _clarabel(P, np.zeros(n + 6), A, b, cones, 1e-12)[0][:n]


def _cutting_planes(G: Array, normals: Array, mu: float, f_min: float) -> Array:
    """Forces (3 N,) of Eq. 4 on outer pyramids with faces added where the solution leaves the cone."""
    N, n = len(normals), 3 * len(normals)
    cone = _cone_rows(normals, mu)
    A = [np.r_[cone[3 * i] / mu] for i in range(N)]
    A += [cone[3 * i] + s * cone[3 * i + j] for i in range(N) for j in (1, 2) for s in (1.0, -1.0)]
    b = [f_min] * N + [0.0] * (4 * N)
    forces, shift = -f_min * normals.ravel(), np.zeros(n)
    H = G.T @ G + 1e-10 * np.eye(n)
    for _ in range(60):
        x, multipliers = np.zeros(n), np.zeros(len(b))
        if solve_qp(H, -1e-10 * shift, np.array(A), np.array(b), x, multipliers) != SOLVED:
            break
        forces, shift = x, x
        values = (cone @ x).reshape(N, 3)
        friction = np.sqrt((values[:, 1:] ** 2).sum(-1))
        cut = np.flatnonzero(friction - values[:, 0] > 1e-13 * (1.0 + friction))
        if not len(cut):
            break
        for i in cut:
            A.append(cone[3 * i] - (values[i, 1:] / friction[i]) @ cone[3 * i + 1 : 3 * i + 3])
            b.append(0.0)
    return forces


def conic_residual(
    points: Numbers,
    normals: Numbers,
    mu: float,
    f_min: float = 1.0,
    length_scale: float | None = None,
    center: Numbers = None,
    tolerance: float = 1e-6,
) -> ConicResidual:
    """Bracket the least value of Eq. 4 with the exact cone.

    Args:
        points: (N, 3) metres. normals: (N, 3) unit, out of the object. mu: friction coefficient.
        f_min: least pressing force [N].
        length_scale: divides torques [m]; None is the contacts' rms radius.
        center: (3,) torque reference; None is the contacts' centroid.
        tolerance: the second method runs where clarabel's bracket does not decide "residual < tolerance".
    """
    points, normals = check_contacts(points, normals)
    if not len(points):
        raise InputError("points must hold at least one contact, got none")
    mu, f_min = check_positive("mu", mu), check_positive("f_min", f_min)
    about = points.mean(0) if center is None else check_array("center", center, (3,))
    scale = rms_radius(points) if length_scale is None else check_positive("length_scale", length_scale)
    G = grasp_map(points, about, scale)
    first = _bracket(G, _conic_qp(G, normals, mu, f_min), normals, mu, f_min, "clarabel")
    if first.closed(tolerance) is not None:
        return first
    second = _bracket(G, _cutting_planes(G, normals, mu, f_min), normals, mu, f_min, "cutting planes")
    lower = max(first.lower, second.lower)
    return (second if second.upper < first.upper else first)._replace(lower=lower)


class ConicMargin(NamedTuple):
    """Closure margin in the exact cone, as in `margin.cone_margin`, for any number of contacts."""

    value: float
    """Of `forces`: N x the least press - |f_t| / mu, with the presses' sum 1; a lower bound of the margin."""
    forces: Array
    """(N, 3), pressing 1 N in all."""
    imbalance: float
    """|wrench| that `forces` leave [N]: rounding, if the value is to be believed."""
    method: str
    """"clarabel", or "cutting planes" where that did not reach "Solved"."""


def conic_margin(points: Numbers, normals: Numbers, mu: float) -> ConicMargin:
    """Return the closure margin in the exact cone.

    It is N x max min_i (press_i - |f_t,i| / mu) over balanced forces whose presses sum to 1.

    Raises:
        InputError: bad contacts, or none of their balanced forces press at all (e.g. all on one face).
    """
    points, normals = check_contacts(points, normals)
    mu, N = check_positive("mu", mu), len(points)
    if N < 2:
        raise InputError(f"a margin needs at least 2 contacts, got {N}")
    G = grasp_map(points, points.mean(0), rms_radius(points))
    cone = _cone_rows(normals, mu) / mu
    x, solved = _margin_socp(G, normals, cone)
    method = "clarabel"
    if not solved:
        x, method = _margin_cuts(G, normals, cone), "cutting planes"
    forces = x[:-1].reshape(N, 3)
    total = -(forces * normals).sum()
    if not np.isfinite(x).all() or total < 1e-9:
        raise InputError(
            "no balanced forces at these contacts press on the object: they may all lie on one face"
        )
    forces = forces / total
    values = (cone @ forces.ravel()).reshape(N, 3)
    wrench = G @ forces.ravel()
    value = N * float((values[:, 0] - np.sqrt((values[:, 1:] ** 2).sum(-1))).min())
    return ConicMargin(value, forces, float(np.sqrt(wrench @ wrench)), method)


def _margin_socp(G: Array, normals: Array, cone: Array) -> tuple[Array, bool]:
    import clarabel

    n, N = G.shape[1], len(normals)
    top = np.zeros((n, 1))
    top[::3] = 1.0
    A = np.block([[G, np.zeros((6, 1))], [-normals.reshape(1, n), np.zeros((1, 1))], [-cone, top]])
    b = np.r_[np.zeros(6), 1.0, np.zeros(n)]
    cones = [clarabel.ZeroConeT(7)] + [clarabel.SecondOrderConeT(3)] * N
    return _clarabel(np.zeros((n + 1, n + 1)), np.r_[np.zeros(n), -1.0], A, b, cones, 1e-10)


def _margin_cuts(G: Array, normals: Array, cone: Array) -> Array:
    """The same by linear programmes on outer pyramids, faces added where the solution leaves the cone."""
    from scipy.optimize import linprog

    n, N = G.shape[1], len(normals)
    rows = [
        np.r_[s * cone[3 * i + j] - cone[3 * i], 1.0] for i in range(N) for j in (1, 2) for s in (1.0, -1.0)
    ]
    equal = np.vstack([np.c_[G, np.zeros(6)], np.r_[-normals.ravel(), 0.0]])
    x = np.full(n + 1, np.nan)
    for _ in range(80):
        answer = linprog(
            np.r_[np.zeros(n), -1.0],
            np.array(rows),
            np.zeros(len(rows)),
            equal,
            np.r_[np.zeros(6), 1.0],
            bounds=(None, None),
        )
        if answer.status != 0:
            break
        x = answer.x
        values = (cone @ x[:-1]).reshape(N, 3)
        friction = np.sqrt((values[:, 1:] ** 2).sum(-1))
        cut = np.flatnonzero(values[:, 0] - friction < x[-1] - 1e-9)
        if not len(cut):
            break
        rows += [
            np.r_[(values[i, 1:] / friction[i]) @ cone[3 * i + 1 : 3 * i + 3] - cone[3 * i], 1.0] for i in cut
        ]
    return x
