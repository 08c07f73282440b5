"""A user's own mesh file made fit for use.

Axes stay as they are in the file (glTF has y up: it keeps that); textures are ignored; the origin moves
to the centre of mass.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from dexgrasp_env.arrays import Arrays
from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError, first_line
from dexgrasp_env.files import cached_arrays, check_archive, content_hash, printable_stem, read_file
from dexgrasp_env.findings import Finding
from dexgrasp_env.objects.decompose import convex_parts
from dexgrasp_env.objects.mesh_file import load_file
from dexgrasp_env.objects.model import ObjectModel, centred_model
from dexgrasp_env.objects.repair import repair
from dexgrasp_env.objects.sets import MESH_SUFFIXES, mesh_file
from dexgrasp_env.ply_file import DamagedMeshError
from dexgrasp_env.yaml_file import read_yaml

DENSITY = 400.0
"""kg/m^3 where no mass is given: everyday things, hollow or half full."""
MASS_RANGE = (0.02, 1.0)
_VERSION = 3
_MOST_FACES = 1_500_000  # to mend: 1.2 kB each


def load_mesh(path: str | os.PathLike[str], *, scale: float = 1.0, mass: float | None = None) -> ObjectModel:
    """Return the object of a mesh file; the repaired surface is cached by the file's content.

    Args:
        path: a file of `MESH_SUFFIXES`.
        scale: factor from the file's unit to metres; dae and 3mf say theirs, and come in metres.
        mass: kilograms; without it 400 kg/m^3, at least 0.02 and at most 1 kg.

    Raises:
        InputError: one line, if the file cannot be used.
    """
    path = mesh_file(path)
    raw = read_mesh(path)
    with np.errstate(over="ignore"):
        raw.apply_scale(scale)
    _check_size(raw, path.name)
    mesh, notes = _repaired(raw, path.name)
    parts, split_notes = convex_parts(mesh)
    notes += split_notes
    narrowest = float(np.min(mesh.bounding_box_oriented.primitive.extents))
    if narrowest > 0.12:
        notes += (
            f"too large for the hand: its narrowest side is {1000 * narrowest:.0f} mm, the hand spans about 120 mm",
        )
    if mass is None:
        given = DENSITY * mesh.volume
        mass = float(np.clip(given, *MASS_RANGE))
        said = f"mass {mass:.3f} kg assumed: {DENSITY:.0f} kg/m3 gives {given:.2g} kg, taken within"
        notes += (f"{said} {MASS_RANGE[0]} to {MASS_RANGE[1]} kg (set it with --mesh-mass)",)
    return centred_model(
        printable_stem(path), mesh, parts, mass, notes=notes, file_centre=np.array(mesh.center_mass)
    )


def describe_mesh(path: str | os.PathLike[str], *, scale: float = 1.0) -> list[Finding]:
    """Return what is the matter with a mesh file and what to do about it; errors come first, never raised."""
    try:
        model = load_mesh(path, scale=scale)
    except InputError as error:
        problem, _, remedy = str(error).partition(": ")
        return [Finding("error", problem, remedy)]
    sides = " x ".join(f"{1000 * side:.0f}" for side in model.extents)
    findings = [
        Finding(
            "info",
            f"fit to use: {sides} mm, {len(model.mesh.faces)} faces, {len(model.parts)} convex parts",
            "nothing to do",
        )
    ]
    remedies = read_yaml(asset_path("objects", "remedies.yaml"))
    for note in model.notes:
        level, remedy = next(known for start, *known in remedies if note.startswith(start))
        findings.append(Finding(level, note, remedy))
    return findings


def read_mesh(path: Path) -> trimesh.Trimesh:
    """Return the triangles of a file in its own unit, checked to be finite and to span a volume.

    Raises:
        InputError: if it is of another kind, damaged, empty, flat or not finite.
    """
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise InputError(
            f"mesh file {path.name!r} has the wrong kind {path.suffix!r}: valid are {', '.join(MESH_SUFFIXES)}"
        )
    if path.stat().st_size == 0:
        raise InputError(f"mesh file {path.name!r} is empty: export it again")
    mesh = _parsed(path)
    if len(mesh.faces) == 0:
        raise InputError(
            f"mesh file {path.name!r} has no faces: export it as triangles, not as points or lines"
        )
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise InputError(
            f"mesh file {path.name!r} is damaged (faces name vertices it does not have): export it again"
        )
    if bad := int((~np.isfinite(mesh.vertices)).any(axis=1).sum()):
        raise InputError(
            f"mesh file {path.name!r} has {bad} vertices that are not finite numbers: export it again"
        )
    return mesh


def _parsed(path: Path) -> trimesh.Trimesh:
    """Read a file with the mesh library, whose many errors become one."""
    kind = path.suffix.lower()[1:]
    try:
        if kind == "3mf":
            check_archive(path)
        loaded = load_file(read_file(path), kind, path.parent)
        _check_faces(loaded, path.name)
        geometry = loaded.to_geometry() if isinstance(loaded, trimesh.Scene) else loaded
    except DamagedMeshError as error:
        raise InputError(f"mesh file {path.name!r} is damaged ({error}): export it again") from None
    except InputError:
        raise
    except Exception as error:  # parsers of damaged files raise whatever they trip over
        raise InputError(
            f"mesh file {path.name!r} cannot be read as {kind} ({first_line(error)[:80]}): export it again"
        ) from error
    if not isinstance(geometry, trimesh.Trimesh):
        return trimesh.Trimesh()
    return trimesh.Trimesh(np.array(geometry.vertices, dtype=float), np.array(geometry.faces), process=False)


def _check_faces(loaded: Any, name: str) -> None:
    """Refuse what is too fine to be mended; the parts of a scene count as often as it shows them."""
    parts = [loaded]
    if isinstance(loaded, trimesh.Scene):
        parts = [loaded.geometry[loaded.graph[node][1]] for node in loaded.graph.nodes_geometry]
    count = sum(len(getattr(part, "faces", ())) for part in parts)
    if count > _MOST_FACES:
        raise InputError(f"mesh file {name!r} has {count:,} faces, more than {_MOST_FACES:,}: decimate it")


def _check_size(mesh: trimesh.Trimesh, name: str) -> None:
    used = mesh.vertices[np.unique(mesh.faces)]
    with np.errstate(over="ignore"):
        largest = float(np.ptp(used, axis=0).max())
    if not largest <= 2.0:
        unit = "millimetres: pass --mesh-scale 0.001" if largest > 40 else (
            "centimetres or millimetres: pass --mesh-scale 0.01 or 0.001")  # fmt: skip
        raise InputError(f"mesh {name!r} is {largest:.4g} m large and looks like {unit}")
    if largest < 0.005:
        raise InputError(
            f"mesh {name!r} is only {1000 * largest:.3g} mm large: "
            "objects need 5 mm at least, pass a larger --mesh-scale"
        )
    spread = np.linalg.svd(used - used.mean(axis=0), compute_uv=False)
    if len(spread) < 3 or spread[2] < 1e-4 * spread[0]:
        raise InputError(f"mesh {name!r} is flat and encloses no volume: give the object a thickness")


def _repaired(raw: trimesh.Trimesh, name: str) -> tuple[trimesh.Trimesh, tuple[str, ...]]:
    """Return the repaired surface and what was done, from the cache where it is known."""
    key = content_hash(np.asarray(raw.vertices), np.asarray(raw.faces, dtype=np.int64), _VERSION)

    def make() -> Arrays:
        """Repair the mesh: what is cached."""
        try:
            mesh, notes = repair(raw)
        except InputError as error:
            raise InputError(f"mesh {name!r} {error}") from None
        if not mesh.volume > 1e-4 * mesh.convex_hull.volume:
            raise InputError(f"mesh {name!r} encloses no volume: close its surface or give it a thickness")
        return {
            "vertices": np.asarray(mesh.vertices),
            "faces": np.asarray(mesh.faces),
            "notes": np.array(notes, dtype=str),
        }

    found = cached_arrays(f"meshes/{key}.npy", make)
    mesh = trimesh.Trimesh(found["vertices"], found["faces"], process=False)
    return mesh, tuple(found["notes"].tolist())
