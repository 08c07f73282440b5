"""Damaged meshes and clouds for `fuzz.py`, from choices that hypothesis makes (`Draw`)."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import quat_to_matrix

Rng = np.random.Generator


def _turned(points: Array, rng: Rng) -> Array:
    quat = rng.normal(size=4)
    return points @ quat_to_matrix(quat / np.linalg.norm(quat)).T


def _not_finite(points: Array, rng: Rng) -> Array:
    some = rng.random(len(points)) < rng.choice([1.5 / (len(points) + 1), rng.uniform()])
    return np.where(some, rng.choice([np.nan, np.inf, -np.inf, 1e300]), points.T).T


MOVES: tuple[Callable[[Array, Rng], Array], ...] = (
    _turned,
    _not_finite,
    lambda points, rng: points + rng.normal(0.0, 10 ** rng.uniform(-5.0, -1.5), points.shape),
    lambda points, rng: points * rng.choice([1e-6, 0.01, 10.0, 1e3, 1e6]),
    lambda points, rng: points * rng.choice([-1.0, 0.0, 1e-4, 1.0], 3),
    lambda points, rng: points + rng.uniform(-1.0, 1.0, 3) * 10 ** rng.uniform(-2.0, 6.0),
    lambda points, rng: np.round(points, 2),
)
"""What happens to points, (N, 3): turned, not finite, noisy, of another unit, mirrored or flat, far away, rounded."""
FACES: tuple[Callable[[Any, Any, int, Rng], Any], ...] = (
    lambda faces, some, count, rng: faces[~some],
    lambda faces, some, count, rng: np.where(some, faces[:, ::-1].T, faces.T).T,
    lambda faces, some, count, rng: np.concatenate([faces, faces[some]]),
    lambda faces, some, count, rng: np.where(some, faces[:, [1, 1, 2]].T, faces.T).T,
    lambda faces, some, count, rng: np.where(some, rng.integers(0, count, faces.T.shape), faces.T).T,
    lambda faces, some, count, rng: faces[:2],
)
"""What happens to some of the faces: lost, turned, doubled, without area, between any of `count` vertices, few left."""
SOLIDS: tuple[Callable[[Rng], trimesh.Trimesh], ...] = (
    lambda rng: trimesh.creation.box(rng.uniform(0.01, 0.2, 3)),
    lambda rng: trimesh.creation.icosphere(2, rng.uniform(0.01, 0.08)),
    lambda rng: trimesh.creation.cylinder(rng.uniform(0.01, 0.06), rng.uniform(0.02, 0.2), sections=16),
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
            faces = draw.one(FACES)(
                faces, rng.random(len(faces)) < rng.uniform(0.01, 0.6), len(vertices), rng
            )
    if draw.upto(9) == 0:  # triangles that share no vertex
        vertices, faces = vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)
    scale, kind = draw.one((1.0, 1.0, 1.0, 0.001)), draw.one(("obj", "stl", "ply", "glb", "off", "3mf"))
    try:
        data = trimesh.Trimesh(vertices / scale, faces, process=False).export(file_type=kind)
    except Exception:  # what cannot be written is a fault of the input, not of the reader
        data = b""
    raw = data.encode() if isinstance(data, str) else bytes(data)
    path = path.with_suffix(f".{kind}")
    path.write_bytes(draw.bytes(raw) if draw.upto(3) == 0 else raw)
    return path, scale


def _scene(count: int, rng: Rng) -> Array:
    """Return points (N, 3) m of a table and of so many solids that stand on it."""
    xy = rng.uniform([0.25, -0.45], [0.80, 0.45], (rng.integers(500, 8000), 2))
    parts = [np.column_stack([xy, rng.normal(0.0, 0.001, len(xy))])]
    for _ in range(count):
        solid = SOLIDS[rng.integers(len(SOLIDS))](rng)
        place = [rng.uniform(0.35, 0.70), rng.uniform(-0.3, 0.3), -solid.bounds[0, 2]]
        parts.append(solid.sample(int(rng.integers(30, 4000)), seed=0) + place)
    return np.concatenate(parts)


CLOUDS: tuple[Callable[[Array, Rng], Array], ...] = (
    *MOVES,
    lambda points, rng: points[np.linalg.norm(points - points[0], axis=1) > rng.uniform(0.01, 0.1)],
    lambda points, rng: np.concatenate([points, rng.uniform(-0.2, 0.9, (rng.integers(1, 500), 3))]),
    lambda points, rng: points[(points - points.mean(0)) @ rng.normal(size=3) > 0.0],
    lambda points, rng: points[rng.integers(0, len(points), rng.integers(0, 60))],
    lambda points, rng: np.repeat(points[: max(1, len(points) // 50)], 50, axis=0),
    lambda points, rng: points[points[:, 2] > 0.004],
)
"""Besides moves: a hole, flying pixels, one side alone, few points, repeated ones, no table."""


def cloud_of(draw: Any) -> Array:
    """Return a scene (N, 3) m of a few things on a table, with up to three damages."""
    rng = draw.rng()
    points = _scene(draw.upto(6, 1), rng)
    for _ in range(draw.upto(3)):
        if len(points):
            points = draw.one(CLOUDS)(points, rng)
    return points


def target_options(draw: Any, points: Array, here: Path) -> list[str]:
    """Return options that point at something in a cloud, or at nothing."""
    rng, n, way, size = draw.rng(), len(points), draw.upto(4), draw.one((0.005, 0.05, 0.1, 1.0, -0.1))
    at = points[draw.upto(n - 1)] if n and draw.upto(4) else rng.choice([0.0, 0.5, -3.0, np.nan, 1e300], 3)
    if way < 3:
        return [[], ["--object-near", *map(str, at)], ["--box", *map(str, [*(at - size), *(at + size)])]][way]
    with np.errstate(all="ignore"):
        near = np.linalg.norm(points - at, axis=1) < size
    masks = (near, rng.integers(-1, 4, n), np.zeros(n, bool), np.ones(n + draw.upto(1), bool), rng.random(n))
    np.save(here / "mask.npy", draw.one((*masks, np.array("mask"))))
    return ["--mask", str(here / "mask.npy"), *(["--label", str(draw.upto(4, -1))] if draw.upto(1) else [])]
