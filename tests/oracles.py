"""Plain, slow statements of what fast code must satisfy; nothing outside the tests uses them."""

import clarabel
import daqp
import numpy as np
from scipy.sparse import csc_matrix

from dexgrasp.mechanics.closure import TOLERANCE, closure_sweep
from dexgrasp.mechanics.cones import tangent_basis
from dexgrasp.mechanics.equilibrium import grasp_map
from dexgrasp.mechanics.simplex import FAR
from dexgrasp.mechanics.wrench import pyramid_rows, restore_feasible


def sample_box(n, rng, half=(0.03, 0.08, 0.105)):
    """Points and normals (n, 3), uniform on a box of half-lengths `half` [m]."""
    size = np.array(half)
    area = size.prod() / size
    axis, side = rng.choice(3, n, p=area / area.sum()), rng.choice([-1.0, 1.0], n)
    points, normals = rng.uniform(-1, 1, (n, 3)) * size, np.zeros((n, 3))
    points[np.arange(n), axis], normals[np.arange(n), axis] = side * size[axis], side
    return points, normals


def sample_can(n, rng, radius=0.033, half=0.05):
    """Points and normals (n, 3), uniform on a cylinder [m]."""
    wall = rng.random(n) < 2 * half / (2 * half + radius)
    angle, end = rng.uniform(0, 2 * np.pi, n), rng.choice([-1.0, 1.0], n)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], 1)
    up = np.array([0.0, 0.0, 1.0])
    on_wall = radius * ring + rng.uniform(-half, half, (n, 1)) * up
    on_end = radius * np.sqrt(rng.random((n, 1))) * ring + half * end[:, None] * up
    points = np.where(wall[:, None], on_wall, on_end)
    return points, np.where(wall[:, None], ring, end[:, None] * up)


def pyramid_violation(forces, normals, mu):
    """Return by how much [N] forces (N, 3) break Eq. 2: max(-press, |f.t_j| - mu press); <= 0 inside."""
    press = -(forces * normals).sum(-1)
    friction = np.max([np.abs((forces * t).sum(-1)) for t in tangent_basis(normals)], axis=0)
    return np.maximum(-press, friction - mu * press)


def directional_error(value, arguments, gradients, moves, step=1e-6):
    """Return how far the analytic slope of `value(*arguments)` along `moves` is from the central difference."""
    ends = [value(*(a + s * m for a, m in zip(arguments, moves, strict=True))) for s in (step, -step)]
    numeric = (ends[0] - ends[1]) / (2 * step)
    analytic = sum((g * m).sum() for g, m in zip(gradients, moves, strict=True))
    return abs(numeric - analytic) / (1 + abs(numeric))


def random_grasps(K, seed=0):
    """Return points and unit normals (K, 3, 3) m, these leaning outwards."""
    rng = np.random.default_rng(seed)
    p = 0.05 * rng.normal(size=(K, 3, 3))
    n = rng.normal(size=(K, 3, 3)) + p / 0.03
    return p, n / np.linalg.norm(n, axis=-1, keepdims=True)


def box_distance(points, sides):
    """Return signed distances (N,) of points (N, 3) to a box about the origin."""
    q = np.abs(points) - sides / 2
    return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)


def closed(points, normals, mu, scale=None):
    """Return which of triples (K, 3, 3) the sweep accepts (K,), one at a time."""
    return np.array(
        [len(closure_sweep(p, n, mu, 0.0, scale)) == 1 for p, n in zip(points, normals, strict=True)]
    )


def proved_closure(points, normals, mu, scale):
    """Return whether Eq. 4's least value (f_min = 1) of one triple is below TOLERANCE, None where nothing is proved.

    No solver's word counts. DAQP gives forces; moved into the cones, either their residual is below the tolerance, or
    the wrench they leave separates: no forces up to FAR have a residual below it. Else clarabel's are tried.
    """
    G = grasp_map(points, points.mean(0), scale)
    A, b = pyramid_rows(normals, mu, 1.0)
    above, sense = np.full(15, 1e30), np.zeros(15, dtype=np.int32)
    x = daqp.solve(G.T @ G + 1e-9 * np.eye(9), np.zeros(9), A, above, b, sense)[0]
    verdict = _proof(G, normals, np.asarray(x).reshape(3, 3), mu)
    if verdict is not None:
        return verdict
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-13
    P = csc_matrix(np.diag(np.r_[np.zeros(9), np.ones(6)]))
    rows = csc_matrix(np.block([[G, -np.eye(6)], [-A, np.zeros((15, 6))]]))
    cones = [clarabel.ZeroConeT(6), clarabel.NonnegativeConeT(15)]
    answer = clarabel.DefaultSolver(P, np.zeros(15), rows, np.r_[np.zeros(6), -b], cones, settings).solve()
    return _proof(G, normals, np.array(answer.x)[:9].reshape(3, 3), mu)


def _proof(G, normals, forces, mu):
    wrench = G @ restore_feasible(forces, normals, mu, 1.0).ravel()
    value = float(wrench @ wrench)
    if value < TOLERANCE:
        return True
    along = (pyramid_rows(normals, mu, 1.0)[0] @ (G.T @ wrench / value**0.5)).reshape(3, 5)
    least = along[:, 0] - mu * np.abs(along[:, 1::2] - along[:, 2::2]).sum(1) / 2
    bound = np.where(least >= 0, least, least * FAR).sum()
    return False if bound > 0 and bound**2 >= TOLERANCE else None


def against_proof(points, normals, mu, scale):
    """Return how many of triples (K, 3, 3) the sweep accepts, decides against the proof, and nothing is proved of."""
    decided = closed(points, normals, mu, scale)
    proved = [proved_closure(p, n, mu, scale) for p, n in zip(points, normals, strict=True)]
    wrong = sum(
        verdict is not None and verdict != mine for verdict, mine in zip(proved, decided, strict=True)
    )
    return int(decided.sum()), wrong, proved.count(None)
