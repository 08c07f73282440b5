"""Accuracy and speed of the signed distances, side by side with trimesh in one run."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp.benchmarks.timing import seconds_of
from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.geometry.exact import closest_on_mesh
from dexgrasp.geometry.grid import GridDistance
from dexgrasp.geometry.samples import surface_samples

if TYPE_CHECKING:
    import trimesh

Solid = tuple["trimesh.Trimesh", Callable[[NDArray[Any]], NDArray[Any]]]
FACES = 8000
"""The least number of triangles of a solid."""
CONVEX_FACES = 200
"""Triangles of the simplified hull, as a planner uses it."""


def run(quick: bool = False) -> dict[str, Any]:
    """Return errors [mm] and times [us a point] by solid and method.

    Errors are against the analytic solid (`analytic`) and against the triangles (`mesh`); points lie 10 mm
    inside to 20 mm outside the surface. `ratio` is trimesh's time over the method's, which includes the
    gradient.

    Args:
        quick: fewer points and repetitions.
    """
    count, repeats = (500, 2) if quick else (20_000, 7)
    return {
        name: _measure(mesh, analytic, count, repeats, 100 if quick else 1000)
        for name, (mesh, analytic) in solids().items()
    }


def solids() -> dict[str, Solid]:
    """Return meshes of the solids and their analytic signed distances."""
    import trimesh

    make = trimesh.creation
    meshes = {
        "sphere": (make.icosphere(5, 0.05), lambda p: _norm(p) - 0.05),
        "box": (make.box((0.06, 0.16, 0.21)), lambda p: _corner(np.abs(p) - np.array([0.03, 0.08, 0.105]))),
        "cylinder": (
            make.cylinder(0.033, 0.1, sections=256),
            lambda p: _corner(np.stack([_norm(p[:, :2]) - 0.033, np.abs(p[:, 2]) - 0.05], -1)),
        ),
        "torus": (
            make.torus(0.04, 0.015, major_sections=128, minor_sections=64),
            lambda p: np.hypot(_norm(p[:, :2]) - 0.04, p[:, 2]) - 0.015,
        ),
    }
    return {name: (_refined(mesh), analytic) for name, (mesh, analytic) in meshes.items()}


def _norm(vectors: NDArray[Any]) -> NDArray[Any]:
    """Return the lengths of vectors (N, k)."""
    return np.sqrt((vectors * vectors).sum(-1))


def _corner(beyond: NDArray[Any]) -> NDArray[Any]:
    """Return the distance to an orthogonal corner, given the distances (N, k) beyond its sides."""
    return _norm(np.maximum(beyond, 0.0)) + np.minimum(beyond.max(axis=-1), 0.0)


def _refined(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return the same surface in at least `FACES` triangles."""
    while len(mesh.faces) < FACES:
        mesh = mesh.subdivide()
    return mesh


def _measure(
    mesh: trimesh.Trimesh,
    analytic: Callable[[NDArray[Any]], NDArray[Any]],
    count: int,
    repeats: int,
    slow_count: int,
) -> dict[str, Any]:
    """Return the figures of one solid."""
    from trimesh.proximity import signed_distance

    rng = np.random.default_rng(0)
    surface = surface_samples(mesh, count, rng)
    points = surface.points + rng.uniform(-0.01, 0.02, (count, 1)) * surface.normals
    truth, some = analytic(points), points[:slow_count]
    methods: dict[str, Any] = {"grid": GridDistance.from_mesh(mesh)}
    if mesh.is_convex:
        methods["convex"] = ConvexDistance.from_mesh(mesh)
        methods[f"convex_{CONVEX_FACES}"] = ConvexDistance.from_mesh(mesh, CONVEX_FACES)
    slow = _time(lambda: signed_distance(mesh, some), slow_count, 1)
    on_mesh = closest_on_mesh(mesh, some).distances
    result: dict[str, Any] = {"faces": len(mesh.faces), "trimesh": {"us": slow}}
    for name, method in methods.items():
        us = _time(partial(method.distance_gradient, points), count, repeats)
        found = method.distance(points)
        result[name] = {
            "us": us,
            "ratio": slow / us,
            "analytic": _errors(found - truth),
            "mesh": _errors(found[:slow_count] - on_mesh),
        }
    return result


def _errors(difference: NDArray[Any]) -> dict[str, float]:
    """Return the largest, 99th percentile and mean size [mm] of differences [m]."""
    size = 1e3 * np.abs(difference)
    return {
        "max_mm": float(size.max()),
        "p99_mm": float(np.quantile(size, 0.99)),
        "mean_mm": float(size.mean()),
    }


def _time(call: Callable[[], object], count: int, repeats: int) -> float:
    """Return the median time [us a point] of a call, compiled by a first one."""
    call()
    return 1e6 * float(np.median(seconds_of(call, repeats))) / count


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
