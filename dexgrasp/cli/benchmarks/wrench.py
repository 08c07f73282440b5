"""Grasp physics: closure of all triples of points against solvers called one triple at a time, side by side."""

import platform
from functools import partial

import numpy as np
import trimesh

from dexgrasp.cli.benchmarks.timing import seconds_of
from dexgrasp.mechanics.closure import closure_sweep
from dexgrasp.mechanics.equilibrium import rms_radius
from dexgrasp.mechanics.margin import margins
from dexgrasp.mechanics.wrench import solve_wrench_qp
from dexgrasp_env.arrays import Array, Fields

MU = 0.5
POINTS = 256


def speed(points: Array, normals: Array, quick: bool, rng: np.random.Generator) -> Fields:
    """Time the sweep, the margin and the solvers on one shape, one core, one after the other; the best of each."""
    scale, repeats = rms_radius(points), 2 if quick else 5
    closures = partial(closure_sweep, points, normals, MU, 0.0)
    feasible = len(closures())
    triples = POINTS * (POINTS - 1) * (POINTS - 2) // 6
    sweep = triples / seconds_of(closures, repeats).min()
    some = np.argsort(rng.random((5_000, POINTS)), axis=1)[:, :3]
    P, N = points[some], normals[some]
    margins(P[:8], N[:8], MU)
    rate = {"closure sweep": sweep}
    for solver, few in (("daqp", 200 if quick else 2_000), ("osqp", 20 if quick else 200)):
        solve_wrench_qp(P[0], N[0], MU, length_scale=scale, solver=solver)
        rate[solver] = few / seconds_of(partial(_solve, P[:few], N[:few], scale, solver), repeats).min()
    return {
        "triples": triples,
        "feasible": feasible,
        "triples_per_s": rate,
        "sweep_over": {solver: sweep / rate[solver] for solver in ("daqp", "osqp")},
        "cone_margin_us": 1e6 * seconds_of(lambda: margins(P, N, MU), repeats).min() / len(P),
    }


def _solve(P: Array, N: Array, scale: float, solver: str) -> None:
    for points, normals in zip(P, N, strict=True):
        solve_wrench_qp(points, normals, MU, length_scale=scale, solver=solver)


def run(quick: bool = False, seed: int = 0) -> Fields:
    """Run the benchmark.

    Args:
        quick: fewer repeats.
        seed: of points and triples.

    Returns:
        A dictionary for JSON: figures of a box and a can, and what they were run with.
    """
    shapes = {
        "box": trimesh.creation.box((0.06, 0.16, 0.21)),
        "can": trimesh.creation.cylinder(radius=0.033, height=0.1),
    }
    rng, figures = np.random.default_rng(seed), Fields()
    for name, mesh in shapes.items():
        points, faces = trimesh.sample.sample_surface(mesh, POINTS, seed=rng)
        figures[name] = speed(np.asarray(points), mesh.face_normals[faces], quick, rng)
    return figures | {
        "machine": f"{platform.machine()}, one core, Python {platform.python_version()}",
        "setting": {"mu": MU, "points": POINTS, "seed": seed},
    }
