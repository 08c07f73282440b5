"""Objects that grasp files name: meshes, found by path or among those given, or objects of the catalogue."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import expand
from dexgrasp_env.objects.catalogue import CATALOGUE
from dexgrasp_env.objects.load import load_object
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.objects.sets import MESH_SUFFIXES


@dataclass(frozen=True)
class ReadOptions:
    """Options of reading: what files may leave open.

    Attributes:
        hand: "allegro", or the path of an MJCF file.
        meshes: mesh files, and folders of them, in which objects are looked for by name.
        mesh_scale: factor from the meshes' unit to metres, beside a scale in the file.
        robot: path of the file of the cell or robot of our own files; None for the simulated cell.
    """

    hand: str = "allegro"
    meshes: tuple[Path, ...] = ()
    mesh_scale: float = 1.0
    robot: str | None = None


def named_object(name: str, scale: float, options: ReadOptions, source: Path) -> ObjectModel:
    """Return the object that a file names.

    Args:
        name: a name of the catalogue, a path (file or object folder), or the stem of a mesh among `options.meshes`.
        scale: factor that the file gives.
        options: where to look.
        source: the grasp file, beside which relative paths are tried too.

    Raises:
        InputError: if it is not found, or cannot be used.
    """
    if not 0.0 < scale < float("inf"):
        raise InputError(f"{source}: object scale {scale} is not a positive number")
    mesh = _given(name, options.meshes) or _on_disk(name, source)
    if mesh is not None:
        return load_object(mesh, scale=scale * options.mesh_scale)
    if name in CATALOGUE:
        return load_object(name, scale=scale)
    raise InputError(
        f"{source}: mesh of object {name!r} not found: name it with --mesh FILE, or a folder that holds "
        f"{_stem(name)}.obj"
    )


def pose_of_centre(T_world_file: Array, model: ObjectModel) -> Array:
    """Return the pose (4, 4) of the centre of mass, from that of the mesh file's frame."""
    T = np.array(T_world_file, dtype=float)
    T[:3, 3] += T[:3, :3] @ model.file_centre
    return T


def _stem(name: str) -> str:
    path = Path(name)
    return path.stem if path.suffix.lower() in MESH_SUFFIXES else path.name


def _given(name: str, meshes: Sequence[Path]) -> Path | None:
    files = [f for f in meshes if f.is_file()]
    folders = [f for f in meshes if f.is_dir()]
    for missing in (m for m in meshes if not m.exists()):
        raise InputError(f"--mesh {str(missing)!r} does not exist: give a mesh file or a folder of them")
    named = [f for f in files if f.stem == _stem(name)]
    named += [p for f in folders for s in MESH_SUFFIXES if (p := f / f"{_stem(name)}{s}").is_file()]
    if not named and len(files) == 1 and not folders:
        return files[0]  # the one mesh that is given is meant
    return named[0] if named else None


def _on_disk(name: str, source: Path) -> Path | None:
    for base in (Path(), source.parent):
        path = base / expand(name)
        if path.is_file() and path.suffix.lower() in MESH_SUFFIXES:
            return path
        # Where the object folders of DexGraspBench (MeshProcess) and DexGraspNet keep the surface
        for part in ("mesh/simplified.obj", "mesh/coacd.obj", "coacd/decomposed.obj"):
            if (path / part).is_file():
                return path / part
    return None
