"""Making a surface watertight, gently first: weld, cut out bad edges and fill holes, remesh, convex hull.

Several shells are made solid one by one and united; cavities are filled.
"""

from __future__ import annotations

import numpy as np
import trimesh

from dexgrasp_env.arrays import Array
from dexgrasp_env.objects.shapes import from_manifold, union

MOST_FACES = 20_000
_CRUMB = 0.01
_MAIN = 0.9
_GRID = 64
_ROUNDS = 4
_HOLLOW = 0.02


def repair(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, tuple[str, ...]]:
    """Return a watertight solid of positive volume near `mesh`, and one sentence for each thing done.

    Steps: weld vertices, drop crumbs under 1 % of the area, simplify to `MOST_FACES` faces, close each
        shell, unite.
    """
    mesh = welded(mesh)
    notes = []
    shells, crumbs = _shells(mesh)
    if crumbs:
        notes.append(f"dropped {crumbs} loose piece{'s' * (crumbs > 1)} of under 1 % of the surface")
    if sum(len(shell.faces) for shell in shells) > MOST_FACES:
        notes.append(f"simplified from {len(mesh.faces)} faces to about {MOST_FACES}")
        share = MOST_FACES / sum(len(shell.faces) for shell in shells)
        shells = [simplified(shell, max(int(len(shell.faces) * share), 100)) for shell in shells]
    closed = [closed_gently(shell) for shell in shells]
    if not all(closed):
        solid, note = _closed_firmly(mesh)
        return solid, (*notes, note)
    notes += dict.fromkeys(note for _, done in filter(None, closed) for note in done)
    solids = [solid for solid, _ in filter(None, closed)]
    if len(solids) > 1:
        notes.append(f"{len(solids)} bodies are taken as one rigid object; cavities are filled")
        solids = [union(solids)]
    return solids[0], tuple(notes)


def welded(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return the bare triangles with equal vertices merged, without empty or double faces."""
    welded = trimesh.Trimesh(np.array(mesh.vertices), np.array(mesh.faces), process=False)
    welded.merge_vertices()
    welded.update_faces(welded.nondegenerate_faces(height=1e-12) & welded.unique_faces())
    welded.remove_unreferenced_vertices()
    return welded


def simplified(mesh: trimesh.Trimesh, faces: int) -> trimesh.Trimesh:
    """Return the mesh with about `faces` faces, by quadric error."""
    import fast_simplification

    points, triangles = fast_simplification.simplify(
        np.asarray(mesh.vertices, dtype=np.float32),
        np.asarray(mesh.faces, dtype=np.int32),
        target_count=faces,
    )[:2]
    return welded(trimesh.Trimesh(points, triangles, process=False))


def is_solid(mesh: trimesh.Trimesh) -> bool:
    """Whether the mesh is closed, consistently wound, and encloses a volume."""
    return bool(
        len(mesh.faces) >= 4 and mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    )


def _shells(mesh: trimesh.Trimesh) -> tuple[list[trimesh.Trimesh], int]:
    """Connected pieces of the surface, and how many negligible ones were left out."""
    pieces = mesh.split(only_watertight=False, repair=False)
    if len(pieces) < 2:
        return [mesh], 0
    kept = [piece for piece in pieces if piece.area >= _CRUMB * mesh.area]
    if sum(piece.area for piece in kept) < _MAIN * mesh.area:
        return [mesh], 0
    return kept, len(pieces) - len(kept)


def closed_gently(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, list[str]] | None:
    """Close one shell by turning faces and filling holes, and say what was done; None if it stays unsound."""
    mesh, notes = _wound(mesh)
    if is_solid(mesh):
        return mesh, notes
    patched, holes = _patched(mesh)
    if is_solid(patched) and patched.volume > _HOLLOW * patched.convex_hull.volume:
        return patched, [*notes, f"filled {holes} hole{'s' * (holes != 1)}"]
    return None


def _closed_firmly(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str]:
    """Close a surface by rebuilding it, or else by its convex hull, with what was done."""
    remeshed = _remeshed(mesh)
    if remeshed is not None:
        return (
            remeshed,
            "rebuilt on a grid as its surface was broken: details under 1/60 of its size are lost",
        )
    return (
        mesh.convex_hull,
        "replaced by its convex hull as its surface could not be closed: hollows are lost",
    )


def _wound(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, list[str]]:
    """Turn the faces outward."""
    notes = []
    if not mesh.is_winding_consistent:
        mesh = mesh.copy()
        trimesh.repair.fix_winding(mesh)
        notes.append("turned faces that were wound the wrong way")
    if mesh.is_watertight and mesh.volume < 0:
        mesh = mesh.copy()
        mesh.invert()
        notes = ["turned faces that were wound the wrong way"]
    return mesh, notes


def _patched(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, int]:
    """Cut out faces at edges of over two faces, fill every hole with a fan; also return how many holes."""
    total = 0
    for _ in range(_ROUNDS):
        mesh = _without_bad_edges(mesh)
        loops = _boundary_loops(mesh)
        if not loops:
            break
        total += len(loops)
        mesh = _with_fans(mesh, loops)
    return _wound(mesh)[0], total


def _without_bad_edges(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    _, inverse, count = np.unique(mesh.edges_sorted, axis=0, return_inverse=True, return_counts=True)
    bad = (count[inverse.ravel()] > 2).reshape(-1, 3).any(axis=1)
    if not bad.any():
        return mesh
    kept = mesh.copy()
    kept.update_faces(~bad)
    kept.remove_unreferenced_vertices()
    return kept


def _boundary_loops(mesh: trimesh.Trimesh) -> list[list[int]]:
    """Closed chains of the open edges, in the direction of their faces."""
    edges = mesh.edges[trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)]
    after: dict[int, list[int]] = {}
    for a, b in edges.tolist():
        after.setdefault(a, []).append(b)
    loops = []
    while after:
        loop = [next(iter(after))]
        while loop[-1] in after:
            following = after[loop[-1]].pop()
            if not after[loop[-1]]:
                del after[loop[-1]]
            if following in loop:
                loops.append(loop[loop.index(following) :])
                del loop[loop.index(following) + 1 :]
            else:
                loop.append(following)
    return [loop for loop in loops if len(loop) >= 3]


def _with_fans(mesh: trimesh.Trimesh, loops: list[list[int]]) -> trimesh.Trimesh:
    vertices, faces = [np.asarray(mesh.vertices)], [np.asarray(mesh.faces)]
    top = len(mesh.vertices)
    for loop in loops:
        rim = np.array(loop)
        if len(rim) == 3:
            faces.append(rim[None, ::-1])
            continue
        vertices.append(mesh.vertices[rim].mean(axis=0, keepdims=True))
        faces.append(np.stack([np.roll(rim, -1), rim, np.full(len(rim), top)], axis=-1))
        top += 1
    return trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces), process=False)


def _remeshed(mesh: trimesh.Trimesh) -> trimesh.Trimesh | None:
    """Surface of the cells that the skin encloses, or None where the skin encloses nothing."""
    inside, origin, pitch = _filled_grid(mesh)
    if inside.sum() < 8:
        return None
    solid = _level_surface(inside, origin, pitch)
    return solid if is_solid(solid) else None


def _filled_grid(mesh: trimesh.Trimesh) -> tuple[np.ndarray, Array, float]:
    """Cells inside the skin, closed over small gaps; the lowest corner of the grid; the side of a cell."""
    from scipy import ndimage

    pitch = float(mesh.extents.max()) / _GRID
    points = mesh.sample(int(min(40 * mesh.area / pitch**2, 2e6)), seed=0)
    origin = mesh.bounds[0] - 4.5 * pitch
    shape = np.ceil((mesh.extents + 9 * pitch) / pitch).astype(int)
    skin = np.zeros(shape, dtype=bool)
    skin[tuple(((points - origin) / pitch).astype(int).T)] = True
    thick = ndimage.binary_dilation(skin, iterations=2)
    filled = ndimage.binary_erosion(ndimage.binary_fill_holes(thick), iterations=2)
    return filled & ~(skin & ~ndimage.binary_erosion(filled)), origin, pitch


def _level_surface(inside: np.ndarray, origin: Array, pitch: float) -> trimesh.Trimesh:
    """Smooth surface half a cell outside the cells `inside`."""
    import manifold3d
    from scipy import ndimage

    depth = ndimage.distance_transform_edt(inside) - ndimage.distance_transform_edt(~inside)
    depth = ndimage.gaussian_filter(depth.astype(float), 0.7) + 0.5

    def level(x: float, y: float, z: float) -> float:
        place = (np.array([x, y, z]) - origin) / pitch - 0.5
        low = np.clip(place.astype(int), 0, np.array(depth.shape) - 2)
        u, v, w = np.clip(place - low, 0.0, 1.0)
        cell = depth[low[0] : low[0] + 2, low[1] : low[1] + 2, low[2] : low[2] + 2]
        plane = cell[0] * (1 - u) + cell[1] * u
        line = plane[0] * (1 - v) + plane[1] * v
        return float(line[0] * (1 - w) + line[1] * w)

    high = origin + pitch * np.array(inside.shape)
    solid = manifold3d.Manifold.level_set(level, [*origin, *high], 1.5 * pitch)
    largest = max(solid.decompose(), key=lambda piece: piece.volume(), default=solid)
    surface = from_manifold(largest)
    return simplified(surface, MOST_FACES) if len(surface.faces) > MOST_FACES else surface
