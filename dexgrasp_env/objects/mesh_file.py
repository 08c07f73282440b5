"""Mesh files to triangles: what the mesh library reads amiss is put right before or after it.

It cuts polygons into fans, which is wrong for concave ones, takes a binary STL whose length is not as it says for
text, and leaves strips of triangles, rows that are cut off and units alone.
"""

import io
import re
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from dexgrasp_env.arrays import Array, Fields, Index, Mask
from dexgrasp_env.extras import from_extra
from dexgrasp_env.files import check_file
from dexgrasp_env.ply_file import DamagedMeshError, load_ply
from dexgrasp_env.poses import frame_of_z
from dexgrasp_env.texts import plain_text, rows_of

_STL_HEAD, _STL_FACE = 84, 50  # bytes
_NEEDED = {"dae": "collada", "3mf": "lxml"}  # by the mesh library to read a kind


def load_file(data: bytes, kind: str, folder: Path) -> Any:
    """Return what a mesh file holds, as the mesh library does: a mesh, a scene or points.

    Args:
        data: of the file.
        kind: obj, stl, ply, glb, gltf, off, dae or 3mf; the last two say their unit, and come in metres.
        folder: in which other files lie that it names.

    Raises:
        DamagedMeshError: for a file that is cut off.
        Exception: whatever else a damaged file makes the parser trip over.
    """
    if kind in _NEEDED:
        with from_extra():
            import_module(_NEEDED[kind])
    options: Any = {}
    if kind == "off":
        return _mesh_of_off(rows_of(data))
    if kind == "stl":
        data = _whole_stl(data)
    elif kind == "obj":
        data = _with_triangles("\n".join(rows_of(data))).encode()
        options = {"skip_materials": True}
    elif kind == "ply":
        return _with_faces(load_ply(data))
    elif kind == "gltf":
        options = {"resolver": _Beside(str(folder))}
    loaded: Any = trimesh.load(io.BytesIO(data), file_type=kind, process=False, **options)
    if kind in _NEEDED and loaded.units:
        loaded.apply_scale(trimesh.units.unit_conversion(loaded.units, "meters"))
    return loaded


class _Beside(trimesh.resolvers.FilePathResolver):
    """Files beside a mesh file, within what is read of somebody else's."""

    def get(self, name: str) -> bytes:
        """Return the bytes of a file."""
        check_file(Path(self.parent) / name)
        return super().get(name)


def _with_faces(loaded: Any) -> Any:
    """Return what a PLY holds with concave polygons cut right, and strips of triangles as faces."""
    elements = loaded.metadata["_ply_raw"]
    if rows := _corner_lists(elements.get("tristrips", {})):
        parts = (part[part >= 0] for row in rows for part in np.split(row, np.flatnonzero(row < 0)))
        faces = trimesh.util.triangle_strips_to_faces([part for part in parts if len(part) > 2])
        proper = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
        return trimesh.Trimesh(loaded.vertices, faces[proper], process=False)
    faces = elements.get("face", {})
    polygons = _corner_lists(faces)
    if polygons and (len(polygons) < faces["length"] or len(polygons[-1]) < 3):
        raise DamagedMeshError("it ends before its last face")
    return _mesh_of(loaded.vertices, polygons) if polygons else loaded


def _corner_lists(element: Fields) -> list[Index]:
    """Return the lists of vertices that the rows of an element of a PLY file are."""
    for name in ("vertex_index", "vertex_indices"):
        if name in element.get("properties", ()):
            rows = element["data"][name]
            return [np.ravel(row) for row in (rows["f1"] if rows.dtype.names else rows)]
    return []


def _mesh_of_off(rows: Sequence[str]) -> trimesh.Trimesh:
    lines = [words for line in rows if (words := line.partition("#")[0].split())]
    if not lines[0][0].endswith("OFF"):
        raise ValueError("no OFF")
    head = lines.pop(0)[1:] or lines.pop(0)
    vertices, faces = map(int, head[:2])
    if len(lines) < vertices + faces:
        raise DamagedMeshError(f"it ends after {len(lines)} of {vertices + faces} lines")
    places = np.array([words[:3] for words in lines[:vertices]], dtype=float)
    polygons = lines[vertices : vertices + faces]
    return _mesh_of(places, [[int(word) for word in corners[: int(count)]] for count, *corners in polygons])


def _mesh_of(vertices: Array, polygons: Sequence[Any]) -> trimesh.Trimesh:
    """Return the triangles of vertices (N, 3) and polygons of three corners or more."""
    pieces = [piece for own in split_concave(vertices, polygons) for piece in own]
    return trimesh.Trimesh(vertices, trimesh.geometry.triangulate_quads(pieces).reshape(-1, 3), process=False)


def split_concave(vertices: Array, polygons: Sequence[Sequence[int]]) -> list[list[Sequence[int]]]:
    """Return for each polygon its triangles where it is concave, and itself where a fan is right.

    Args:
        vertices: (N, 3) m.
        polygons: indices of their corners, three or more each.
    """
    pieces: list[list[Sequence[int]]] = [[polygon] for polygon in polygons]
    sizes = np.array([len(polygon) for polygon in polygons], dtype=int)
    for size in np.unique(sizes[sizes > 3]):
        rows = np.flatnonzero(sizes == size)
        corners = np.asarray(vertices)[np.array([polygons[row] for row in rows.tolist()])]
        concave = _is_concave(corners)
        for row, own in zip(rows[concave].tolist(), corners[concave], strict=True):
            pieces[row] = [[polygons[row][i] for i in piece] for piece in _ears(own)]
    return pieces


def _is_concave(corners: Array) -> Mask:
    """Return which polygons (M, n, 3) turn against their own sense at a corner."""
    edges = np.roll(corners, -1, axis=1) - corners
    turns = np.cross(edges, np.roll(edges, -1, axis=1))
    normals = _normals(corners)
    across = np.einsum("mni,mi->mn", turns, normals)
    # Turns of less than a share of the square of twice the polygon's area are straight on.
    return (across < -1e-9 * (normals**2).sum(-1, keepdims=True)).any(axis=1)


def _normals(corners: Array) -> Array:
    """Return normals of polygons (..., n, 3), as long as twice their areas (Newell)."""
    local = corners - corners[..., :1, :]
    return np.cross(local, np.roll(local, -1, axis=-2)).sum(-2)


def _ears(corners: Array) -> Any:
    """Return the triangles (n - 2, 3) of a polygon (n, 3)."""
    import manifold3d

    normal = _normals(corners)
    flat = (corners - corners[0]) @ frame_of_z(normal / np.linalg.norm(normal))[:, :2]
    return manifold3d.triangulate([flat])


def _with_triangles(text: str) -> str:
    """Return an OBJ text with its concave polygons cut into triangles."""
    if not re.search(r"^f(?:[ \t]+[^\s\\]+){3}[ \t]+\S", text, re.MULTILINE):
        return text
    lines = text.replace("\\\r\n", " ").replace("\\\n", " ").splitlines()
    vertices, rows, polygons = list[list[str]](), list[int](), list[list[int]]()
    for row, line in enumerate(lines):
        kind, *words = line.split() or [""]
        if kind == "v":
            vertices.append(words[:3])
        elif kind == "f" and len(words) > 3:
            given = [int(word.partition("/")[0]) for word in words]
            polygons.append([k - 1 if k > 0 else len(vertices) + k for k in given])
            rows.append(row)
    for row, pieces in zip(rows, split_concave(np.array(vertices, dtype=float), polygons), strict=True):
        if len(pieces) > 1:
            lines[row] = "\n".join(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in pieces)
    return "\n".join(lines)


def _whole_stl(data: bytes) -> bytes:
    """Return an STL without what follows its triangles."""
    if plain_text(data[:_STL_HEAD]).lstrip()[:5].lower() == b"solid":
        text = "\n".join(rows_of(data)).lower()
        if "facet" in text and "\0" not in text:
            if "endsolid" not in text.rpartition("facet")[2]:
                raise DamagedMeshError("it ends before its last facet")
            return text.encode()
    if len(data) < _STL_HEAD:
        return data
    count, held = int.from_bytes(data[80:_STL_HEAD], "little"), (len(data) - _STL_HEAD) // _STL_FACE
    if held < count:
        raise DamagedMeshError(f"it ends after {held} of {count} triangles")
    return data[: _STL_HEAD + _STL_FACE * count]
