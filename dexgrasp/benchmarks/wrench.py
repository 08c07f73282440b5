"""Grasp physics: the closure decision against solvers called one at a time, side by side, and its
agreement.

**Agreement.** The reference is not a solver's word but a proof. DAQP, which shares no code with the
decision, gives forces for each triple; in plain numpy they are moved into the cones, and either their
residual is below the tolerance (feasible, proved) or the wrench they leave separates: no forces up to 1e6
f_min have a smaller residual than a bound above it (infeasible, proved). What DAQP's answer proves neither
way goes to clarabel, then counts as `undecided`. The **band** is where the closed form changes its verdict
between mu / 1.02 and 1.02 mu, and triples whose height is below 0.4 % of their longest side.
"""

import platform
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp.benchmarks.timing import seconds_of
from dexgrasp.physics.checks import rms_radius
from dexgrasp.physics.closure import (
    BAND,
    FORCE_BOUND,
    LINE,
    TOLERANCE,
    closure_count,
    closure_decide,
    in_closed_form,
)
from dexgrasp.physics.margin import margins
from dexgrasp.physics.wrench import grasp_map, pyramid_rows, restore_feasible, solve_wrench_qp
from dexgrasp_env.arrays import Array

MU = 0.5
POINTS = 256


def sample_box(
    n: int, rng: np.random.Generator, half: tuple[float, float, float] = (0.03, 0.08, 0.105)
) -> tuple[Array, Array]:
    """Points and normals (n, 3), uniform on a box of half-lengths `half` [m]."""
    size = np.array(half)
    area = size.prod() / size
    axis, side = rng.choice(3, n, p=area / area.sum()), rng.choice([-1.0, 1.0], n)
    points, normals = rng.uniform(-1, 1, (n, 3)) * size, np.zeros((n, 3))
    points[np.arange(n), axis], normals[np.arange(n), axis] = side * size[axis], side
    return points, normals


def sample_can(
    n: int, rng: np.random.Generator, radius: float = 0.033, half: float = 0.05
) -> tuple[Array, Array]:
    """Points and normals (n, 3), uniform on a cylinder [m]."""
    wall = rng.random(n) < 2 * half / (2 * half + radius)
    angle, end = rng.uniform(0, 2 * np.pi, n), rng.choice([-1.0, 1.0], n)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], 1)
    up = np.array([0.0, 0.0, 1.0])
    on_wall = radius * ring + rng.uniform(-half, half, (n, 1)) * up
    on_end = radius * np.sqrt(rng.random((n, 1))) * ring + half * end[:, None] * up
    points = np.where(wall[:, None], on_wall, on_end)
    return points, np.where(wall[:, None], ring, end[:, None] * up)


def add_noise(points: Array, normals: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """The same with 2 mm on points and about 6 deg on normals."""
    turned = normals + 0.1 * rng.normal(size=normals.shape)
    return points + 0.002 * rng.normal(size=points.shape), turned / np.sqrt((turned**2).sum(1, keepdims=True))


def _shapes(rng: np.random.Generator) -> dict[str, tuple[Array, Array]]:
    box, can = sample_box(POINTS, rng), sample_can(POINTS, rng)
    grid = (np.round(box[0] / 0.01) * 0.01, box[1])
    return {
        "box": box,
        "can": can,
        "noisy box": add_noise(*box, rng),
        "noisy can": add_noise(*can, rng),
        "box on a 1 cm grid": grid,
    }


def _draw(count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    triples = np.sort(rng.integers(0, POINTS, (2 * count, 3)), 1)
    return triples[(np.diff(triples, axis=1) > 0).all(1)][:count]


def _best(action: Callable[[], object], repeats: int) -> float:
    return float(seconds_of(action, repeats).min())


def proof(G: Array, normals: Array, forces: Array, mu: float) -> bool | None:
    """What forces (3, 3) prove about Eq. 4 < TOLERANCE with f_min = 1: True, False, or None for nothing."""
    t = restore_feasible(forces, normals, mu, 1.0)
    wrench = G @ t.ravel()
    value = float(wrench @ wrench)
    if value < TOLERANCE:
        return True
    A, _ = pyramid_rows(normals, mu, 1.0)
    h = (G.T @ wrench / value**0.5).reshape(3, 3)
    along = (A @ h.ravel()).reshape(3, 5)
    press = along[:, 0]
    friction = np.abs(along[:, 1::2] - along[:, 2::2]).sum(1) / 2
    least = press - mu * friction
    bound = np.where(least >= 0, least, least * FORCE_BOUND).sum()
    return False if bound > 0 and bound**2 >= TOLERANCE else None


def reference(points: Array, normals: Array, mu: float, scale: float) -> bool | None:
    """Decide one triple with proof (the module's text says how); None where nothing is proved."""
    import daqp

    G = grasp_map(points, points.mean(0), scale)
    A, b = pyramid_rows(normals, mu, 1.0)
    H = G.T @ G + 1e-9 * np.eye(9)
    x, _, _, _ = daqp.solve(H, np.zeros(9), A, np.full(15, 1e30), b, np.zeros(15, dtype=np.int32))
    verdict = proof(G, normals, np.asarray(x).reshape(3, 3), mu)
    return _clarabel(G, A, b, normals, mu) if verdict is None else verdict


def _clarabel(G: Array, A: Array, b: Array, normals: Array, mu: float) -> bool | None:
    import clarabel
    from scipy.sparse import csc_matrix

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-13
    P = csc_matrix(np.diag(np.r_[np.zeros(9), np.ones(6)]))
    rows = csc_matrix(np.block([[G, -np.eye(6)], [-A, np.zeros((15, 6))]]))
    cones = [clarabel.ZeroConeT(6), clarabel.NonnegativeConeT(15)]
    answer = clarabel.DefaultSolver(P, np.zeros(15), rows, np.r_[np.zeros(6), -b], cones, settings).solve()
    return proof(G, normals, np.array(answer.x)[:9].reshape(3, 3), mu)


def agreement(
    name: str, points: Array, normals: Array, count: int, rng: np.random.Generator
) -> dict[str, Any]:
    """Compare the decision with the reference on `count` random triples of one shape."""
    triples, scale = _draw(count, rng), rms_radius(points)
    P, N = points[triples], normals[triples]
    decided = closure_decide(P, N, MU, scale)
    band = in_closed_form(P, N, MU * BAND) != in_closed_form(P, N, MU / BAND)
    side = [((P[:, i] - P[:, (i + 1) % 3]) ** 2).sum(-1) for i in range(3)]
    height = np.sqrt((np.cross(P[:, 1] - P[:, 0], P[:, 2] - P[:, 0]) ** 2).sum(-1)) / np.maximum(
        np.max(side, 0), 1e-300
    )
    band |= height < LINE
    verdicts = [reference(P[k], N[k], MU, scale) for k in range(len(P))]
    open_ = np.array([v is None for v in verdicts])
    wrong = ~open_ & (np.array([bool(v) for v in verdicts]) != decided)
    return {
        "shape": name,
        "triples": len(P),
        "feasible": int(decided.sum()),
        "in_band": int(band.sum()),
        "undecided": int(open_.sum()),
        "disagree_in_band": int((wrong & band).sum()),
        "disagree_outside": int((wrong & ~band).sum()),
    }


def speed(name: str, points: Array, normals: Array, quick: bool, rng: np.random.Generator) -> dict[str, Any]:
    """Time the decision and the solvers on one shape, one core, one after the other."""
    scale, repeats = rms_radius(points), 2 if quick else 5
    counts = closure_count(points, normals, MU, 0.0)
    sweep = counts.triples / _best(lambda: closure_count(points, normals, MU, 0.0), repeats)
    listed = _draw(20_000 if quick else 200_000, rng)
    P, N = points[listed], normals[listed]
    closure_decide(P[:8], N[:8], MU, scale)
    random = len(P) / _best(lambda: closure_decide(P, N, MU, scale), repeats)
    margins(P[:8], N[:8], MU)
    some = slice(0, 5_000)
    rate = {"closure sweep": sweep, "closure, random list": random}
    for solver, few in (("daqp", 200 if quick else 2_000), ("osqp", 20 if quick else 200)):
        solve_wrench_qp(P[0], N[0], MU, length_scale=scale, solver=solver)
        start = time.perf_counter()
        for k in range(few):
            solve_wrench_qp(P[k], N[k], MU, length_scale=scale, solver=solver)
        rate[f"qpsolvers {solver}"] = few / (time.perf_counter() - start)
    return {
        "shape": name,
        **counts._asdict(),
        "triples_per_s": rate,
        "sweep_over": {solver: sweep / rate[f"qpsolvers {solver}"] for solver in ("daqp", "osqp")},
        "cone_margin_us": 1e6 * _best(lambda: margins(P[some], N[some], MU), repeats) / 5_000,
    }


def run(quick: bool = False, n: int | None = None, seed: int = 0) -> dict[str, Any]:
    """Run the benchmark.

    Args:
        quick: fewer repeats, and 2,000 triples for the agreement.
        n: triples for the agreement over five shapes; None is 100,000 (about half a minute).
        seed: of points and triples.

    Returns:
        A dictionary for JSON: `speed` (box, can), `agreement` (five shapes) and what they were run with.
    """
    rng = np.random.default_rng(seed)
    shapes = _shapes(rng)
    count = (2_000 if quick else 100_000) if n is None else n
    return {
        "machine": f"{platform.machine()}, one core, Python {platform.python_version()}",
        "setting": {"mu": MU, "points": POINTS, "tolerance": TOLERANCE, "band": BAND, "seed": seed},
        "speed": [speed(name, *shapes[name], quick, rng) for name in ("box", "can")],
        "agreement": [
            agreement(name, *shape, -(-count // len(shapes)), rng) for name, shape in shapes.items()
        ],
    }
