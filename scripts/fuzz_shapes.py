"""Damaged meshes and clouds for `fuzz.py`, from choices that hypothesis makes (`Draw`)."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from dexgrasp_env.arrays import Array

Rng = np.random.Generator


def _not_finite(points: Array, rng: Rng) -> Array:
    some = rng.random(len(points)) < rng.choice([1.5 / (len(points) + 1), rng.uniform()])
    return np.where(some, rng.choice([np.nan, np.inf, -np.inf, 1e300]), points.T).T


MOVES: tuple[Callable[[Array, Rng], Array], ...] = (
    _not_finite,
    lambda points, rng: points + rng.normal(0.0, 10 ** rng.uniform(-5.0, -1.5), points.shape),
    lambda points, rng: points * rng.choice([1e-6, 0.01, 10.0, 1e3, 1e6]),
    lambda points, rng: points * rng.choice([-1.0, 0.0, 1e-4, 1.0], 3),
    lambda points, rng: points + rng.uniform(-1.0, 1.0, 3) * 10 ** rng.uniform(-2.0, 6.0),
)
"""What happens to points, (N, 3): not finite, noisy, of another unit, mirrored or flat, far away."""
FACES: tuple[Callable[[Any, Any, int, Rng], Any], ...] = (
    lambda faces, some, count, rng: faces[~some],
    lambda faces, some, count, rng: np.where(some, faces[:, ::-1].T, faces.T).T,
    lambda faces, some, count, rng: np.concatenate([faces, faces[some]]),
    lambda faces, some, count, rng: np.where(some, rng.integers(0, count, faces.T.shape), faces.T).T,
)
"""What happens to some of the faces: lost, turned, doubled, between any of `count` vertices."""
SOLIDS: tuple[Callable[[Rng], trimesh.Trimesh], ...] = (
    lambda rng: trimesh.creation.box(rng.uniform(0.01, 0.2, 3)),
    lambda rng: trimesh.creation.icosphere(2, rng.uniform(0.01, 0.08)),
    lambda rng: trimesh.creation.torus(0.05, rng.uniform(0.005, 0.02), 16, 8),
    lambda rng: trimesh.creation.annulus(0.02, 0.04, rng.uniform(0.02, 0.15), sections=16),
)


def mesh_of(draw: Any, path: Path) -> tuple[Path, float]:
    """Write a mesh with up to three faults of real files; return its path, and the scale to read it with."""
    rng = draw.rng()
    mesh = trimesh.util.concatenate([draw.one(SOLIDS)(rng) for _ in range(draw.upto(2, 1))])
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)
    for _ in range(draw.upto(3)):
        if draw.upto(1):
            vertices = draw.one(MOVES)(vertices, rng)
        else:
            some = rng.random(len(faces)) < rng.uniform(0.01, 0.6)
            faces = draw.one(FACES)(faces, some, len(vertices), rng)
    scale, kind = draw.one((1.0, 1.0, 1.0, 0.001)), draw.one(("obj", "stl", "ply", "glb", "off", "3mf"))
    path = path.with_suffix(f".{kind}")
    try:
        trimesh.Trimesh(vertices / scale, faces, process=False).export(path)
    except Exception:  # what cannot be written is a fault of the input, not of the reader
        path.write_bytes(b"")
    if draw.upto(3) == 0:
        path.write_bytes(draw.bytes(path.read_bytes()))
    return path, scale


CLOUDS: tuple[Callable[[Array, Rng], Array], ...] = (
    *MOVES,
    lambda points, rng: points[np.linalg.norm(points - points[0], axis=1) > rng.uniform(0.01, 0.1)],
    lambda points, rng: np.concatenate([points, rng.uniform(-0.2, 0.9, (rng.integers(1, 500), 3))]),
    lambda points, rng: points[rng.integers(0, len(points), rng.integers(0, 60))],
    lambda points, rng: points[points[:, 2] > 0.004],
)
"""Besides moves: a hole, flying pixels, few points, no table."""


def cloud_of(draw: Any) -> Array:
    """Return points (N, 3) m of a table and a few solids on it, with up to three damages."""
    rng = draw.rng()
    xy = rng.uniform([0.25, -0.45], [0.80, 0.45], (rng.integers(500, 8000), 2))
    parts = [np.column_stack([xy, rng.normal(0.0, 0.001, len(xy))])]
    for _ in range(draw.upto(6, 1)):
        solid = draw.one(SOLIDS)(rng)
        place = [rng.uniform(0.35, 0.70), rng.uniform(-0.3, 0.3), -solid.bounds[0, 2]]
        parts.append(solid.sample(int(rng.integers(30, 4000)), seed=0) + place)
    points = np.concatenate(parts)
    for _ in range(draw.upto(3)):
        if len(points):
            points = draw.one(CLOUDS)(points, rng)
    return points


def target_options(draw: Any, points: Array, here: Path) -> list[str]:
    """Return options that point at something in a cloud, or at nothing."""
    rng, n, size = draw.rng(), len(points), draw.one((0.005, 0.1, -0.1))
    at = points[draw.upto(n - 1)] if n and draw.upto(4) else rng.choice([0.0, -3.0, np.nan, 1e300], 3)
    masks = (rng.integers(-1, 4, n), np.zeros(n, bool), np.ones(n + 1, bool), rng.random(n), np.array("mask"))
    np.save(here / "mask.npy", draw.one(masks))
    ways = (
        [],
        ["--object-near", *map(str, at)],
        ["--box", *map(str, [*(at - size), *(at + size)])],
        ["--mask", str(here / "mask.npy"), "--label", str(draw.upto(4, -1))],
    )
    return draw.one(ways)
