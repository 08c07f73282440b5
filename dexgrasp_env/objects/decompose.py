"""Convex parts of a mesh, in a process of their own: a crash or a leak there takes nobody down.

Run as `python -m dexgrasp_env.objects.decompose IN.npz OUT.npz`.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import trimesh

from dexgrasp_env.files import Arrays, cached_arrays, content_hash
from dexgrasp_env.objects.model import reduced_hull
from dexgrasp_env.objects.parts import MAX_VERTICES, ContactPart
from dexgrasp_env.objects.repair import closed_gently, simplified

CONVEX = 0.96
"""Share of its convex hull's volume from which a solid counts as convex."""
_MOST_PARTS = 8
_VERTICES = 64
_THRESHOLD = 0.05
_FACES = 3000
_TIMEOUT = 180.0
_VERSION = 2
_LAYOUT = {"points": (None, 3), "counts": (None,)}


def convex_parts(
    mesh: trimesh.Trimesh, timeout: float = _TIMEOUT
) -> tuple[tuple[ContactPart, ...], tuple[str, ...]]:
    """Return the convex parts of a watertight mesh, and one sentence for each thing to know of them.

    A nearly convex mesh is one part. Others are decomposed by CoACD with a fixed seed, cached by content; if
    that fails or takes longer than `timeout` seconds, the convex hull stands in.
    """
    hull = mesh.convex_hull
    if mesh.volume > CONVEX * hull.volume:
        return (_part(np.asarray(hull.vertices)),), ()
    try:
        found = cached_arrays(f"parts/{_key(mesh)}.npz", _LAYOUT, lambda: _run(mesh, timeout))
    except _DecompositionError:
        return (_part(np.asarray(hull.vertices)),), (
            "could not be split into convex parts: in contact its convex hull stands in",
        )
    pieces = np.split(found["points"], np.cumsum(found["counts"])[:-1])
    return tuple(map(_part, pieces)), (f"split into {len(pieces)} convex parts",)


class _DecompositionError(Exception):
    """The other process failed."""


def decompose(vertices: np.ndarray, faces: np.ndarray) -> list[np.ndarray]:
    """Return the vertices (n, 3) of each convex part, by CoACD with a fixed seed."""
    import coacd

    coacd.set_log_level("error")
    parts = coacd.run_coacd(
        coacd.Mesh(vertices, faces),
        threshold=_THRESHOLD,
        max_convex_hull=_MOST_PARTS,
        preprocess_mode="off",
        mcts_iterations=60,
        resolution=1000,
        seed=1,
    )
    return [np.asarray(reduced_hull(np.asarray(points), _VERTICES).vertices) for points, _ in parts]


def _coarse(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The same solid with about `_FACES` faces, which is as good for parts and several times as fast."""
    if len(mesh.faces) <= _FACES:
        return mesh
    coarse = closed_gently(simplified(mesh, _FACES))
    return coarse[0] if coarse and 0.9 < coarse[0].volume / mesh.volume < 1.1 else mesh


def _part(points: np.ndarray) -> ContactPart:
    return ContactPart("mesh", vertices=np.asarray(reduced_hull(points, MAX_VERTICES).vertices))


def _key(mesh: trimesh.Trimesh) -> str:
    settings = (_VERSION, _MOST_PARTS, _VERTICES, _THRESHOLD)
    return content_hash(
        np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64), settings
    )


def _run(mesh: trimesh.Trimesh, timeout: float) -> Arrays:
    """Decompose in another process: points (n, 3) of all parts, and how many are whose."""
    with tempfile.TemporaryDirectory(prefix="dexgrasp") as folder:
        given, made = Path(folder, "in.npz"), Path(folder, "out.npz")
        coarse = _coarse(mesh)
        np.savez(given, vertices=np.asarray(coarse.vertices), faces=np.asarray(coarse.faces, dtype=np.int64))
        root = str(Path(__file__).resolve().parents[2])
        paths = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
        command = [sys.executable, "-m", "dexgrasp_env.objects.decompose", str(given), str(made)]
        env = {**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1"}
        try:
            done = subprocess.run(command, env=env, capture_output=True, timeout=timeout, check=False)
        except (subprocess.TimeoutExpired, OSError) as error:
            raise _DecompositionError from error
        if done.returncode != 0 or not made.is_file():
            raise _DecompositionError(done.stderr.decode(errors="replace"))
        with np.load(made, allow_pickle=False) as data:
            return {name: data[name] for name in data.files}


def main(given: str, made: str) -> None:
    """Decompose the mesh of one file into another file."""
    with np.load(given, allow_pickle=False) as data:
        parts = decompose(data["vertices"], data["faces"])
    np.savez(made, points=np.concatenate(parts), counts=[len(points) for points in parts])


if __name__ == "__main__":
    main(*sys.argv[1:3])
