"""Making a surface watertight, gently first: weld, cut out bad edges and fill holes, remesh, convex hull.

Several shells are made solid one by one and united; cavities are filled.
"""

import numpy as np
import trimesh
from scipy.spatial import QhullError

from dexgrasp_env.arrays import Array, Mask
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.shapes import from_manifold, union

GRID = 64
"""Cells along the longest side."""
MOST_FACES = 20_000
_SIZE = 0.05  # of each side: by how much a repair may change it without a word


def remeshed(mesh: trimesh.Trimesh) -> trimesh.Trimesh | None:
    """Surface of the cells that the skin encloses, or None where the skin encloses nothing."""
    inside, origin, pitch = _filled_grid(mesh)
    if inside.sum() < 8:
        return None
    return _level_surface(inside, origin, pitch)


def _filled_grid(mesh: trimesh.Trimesh) -> tuple[Mask, Array, float]:
    """Cells inside the skin, closed over small gaps; the lowest corner of the grid; the side of a cell."""
    from scipy import ndimage

    pitch = float(mesh.extents.max()) / GRID
    points = mesh.sample(int(min(40 * mesh.area / pitch**2, 2e6)), seed=0)
    origin = mesh.bounds[0] - 4.5 * pitch
    skin = np.zeros(np.ceil((mesh.extents + 9 * pitch) / pitch).astype(int), dtype=bool)
    skin[tuple(((points - origin) / pitch).astype(int).T)] = True
    thick = ndimage.binary_dilation(skin, iterations=2)
    filled = ndimage.binary_erosion(ndimage.binary_fill_holes(thick), iterations=2)
    return filled & ~(skin & ~ndimage.binary_erosion(filled)), origin, pitch


def _level_surface(inside: Mask, origin: Array, pitch: float) -> trimesh.Trimesh:
    """Smooth surface half a cell outside the cells `inside`."""
    import manifold3d
    from scipy import ndimage

    depth = ndimage.distance_transform_edt(inside) - ndimage.distance_transform_edt(~inside)
    depth = ndimage.gaussian_filter(depth, 0.7) + 0.5

    cells = depth.ravel().tolist()  # Python's floats: it is called 100,000 times
    _, rows, columns = depth.shape
    (ox, oy, oz), (nx, ny, nz) = origin.tolist(), (side - 2 for side in depth.shape)

    def level(x: float, y: float, z: float) -> float:
        """Return the depth in a place, trilinear between cells."""
        u, v, w = (x - ox) / pitch - 0.5, (y - oy) / pitch - 0.5, (z - oz) / pitch - 0.5
        i, j, k = min(max(int(u), 0), nx), min(max(int(v), 0), ny), min(max(int(w), 0), nz)
        u, v, w = min(max(u - i, 0.0), 1.0), min(max(v - j, 0.0), 1.0), min(max(w - k, 0.0), 1.0)
        corner = (i * rows + j) * columns + k
        a, b, c, d = (
            cells[at] * (1 - w) + cells[at + 1] * w
            for at in (corner, corner + columns, corner + rows * columns, corner + (rows + 1) * columns)
        )
        return float((a * (1 - v) + b * v) * (1 - u) + (c * (1 - v) + d * v) * u)

    high = origin + pitch * np.array(inside.shape)
    solid = manifold3d.Manifold.level_set(level, [*origin, *high], 1.5 * pitch)
    surface = from_manifold(max(solid.decompose(), key=lambda piece: piece.volume(), default=solid))
    return simplified(surface, MOST_FACES) if len(surface.faces) > MOST_FACES else surface


def repair(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, tuple[str, ...]]:
    """Return a watertight solid of possible inertia near `mesh`, and one sentence for each thing done.

    Steps: weld vertices, drop crumbs under 1 % of the area, simplify to `MOST_FACES` faces, close each
        shell, unite. Where the result is unsound or of another size it is rebuilt on a grid; where that is, its
        convex hull stands in.

    Raises:
        InputError: if it bounds no volume.
    """
    mesh = welded(mesh)
    if len(mesh.faces) == 0:
        raise InputError("has only faces without area: export it again")
    notes = []
    shells, crumbs = _shells(mesh)
    if crumbs:
        notes.append(f"dropped {crumbs} loose piece{'s' * (crumbs > 1)} of under 1 % of the surface")
    given = shells[0] if len(shells) == 1 else welded(trimesh.util.concatenate(shells))  # type: ignore[arg-type]
    if len(given.faces) > MOST_FACES:
        notes.append(f"simplified from {len(mesh.faces)} faces to about {MOST_FACES}")
        share = MOST_FACES / len(given.faces)
        shells = [simplified(shell, max(int(len(shell.faces) * share), 100)) for shell in shells]
    solid, done = _united(shells)
    if solid is None or not (is_sound(solid) and _same_size(solid, given)):
        solid, done = _closed_firmly(given)
    return solid, (*notes, *done, *_size_notes(solid, given))


def _united(shells: list[trimesh.Trimesh]) -> tuple[trimesh.Trimesh | None, list[str]]:
    """Close every shell gently and unite them; None where one stays open."""
    closed = [found for shell in shells if (found := closed_gently(shell))]
    if len(closed) < len(shells):
        return None, []
    solids = [solid for solid, _ in closed]
    notes = [*dict.fromkeys(note for _, done in closed for note in done)]
    if len(solids) == 1:
        return solids[0], notes
    return union(solids), [*notes, f"{len(solids)} bodies are taken as one rigid object; cavities are filled"]


def _same_size(solid: trimesh.Trimesh, given: trimesh.Trimesh) -> bool:
    """Return True where the box around it is that of the surface given, within 5 % of each side or a cell."""
    allowed = np.maximum(_SIZE * given.extents, 1.5 * float(given.extents.max()) / GRID)
    return bool((np.abs(solid.bounds - given.bounds) <= allowed).all())


def _size_notes(solid: trimesh.Trimesh, given: trimesh.Trimesh) -> list[str]:
    if (np.abs(solid.extents - given.extents) <= _SIZE * given.extents).all():
        return []
    was, now = (" x ".join(f"{1000 * side:.1f}" for side in mesh.extents) for mesh in (given, solid))
    return [f"resized: {was} mm were given, {now} mm are left"]


def _shells(mesh: trimesh.Trimesh) -> tuple[list[trimesh.Trimesh], int]:
    """Connected pieces of the surface, and how many negligible ones were left out."""
    pieces = mesh.split(only_watertight=False, repair=False)
    if len(pieces) < 2:
        return [mesh], 0
    kept = [piece for piece in pieces if piece.area >= 0.01 * mesh.area]  # the others are crumbs
    if sum(piece.area for piece in kept) < 0.9 * mesh.area:
        return [mesh], 0
    return kept, len(pieces) - len(kept)


def closed_gently(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, list[str]] | None:
    """Close one shell by turning faces and filling holes, and say what was done; None if it stays unsound."""
    mesh, notes = _wound(mesh)
    if is_solid(mesh):
        return mesh, notes
    patched, holes = _patched(mesh)
    if is_solid(patched) and patched.volume > 0.02 * patched.convex_hull.volume:
        return patched, [*notes, f"filled {holes} hole{'s' * (holes != 1)}"]
    return None


def _closed_firmly(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, list[str]]:
    """Close a surface by rebuilding it, or else by its convex hull, with what was done."""
    rebuilt = remeshed(mesh)
    if rebuilt is not None and is_sound(rebuilt) and _same_size(rebuilt, mesh):
        return rebuilt, [
            "rebuilt on a grid as its surface was broken: details under 1/60 of its size are lost"
        ]
    try:
        hull = mesh.convex_hull
    except QhullError:
        raise InputError("is flat and encloses no volume: give the object a thickness") from None
    return hull, ["replaced by its convex hull as its surface could not be closed: hollows are lost"]


def _wound(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, list[str]]:
    """Turn the faces outward."""
    turned, mesh = not mesh.is_winding_consistent, mesh.copy()
    trimesh.repair.fix_winding(mesh)
    if mesh.is_watertight and mesh.volume < 0:
        turned = True
        mesh.invert()
    return mesh, ["turned faces that were wound the wrong way"] * turned


def _patched(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, int]:
    """Cut out faces at edges of over two faces, fill every hole with a fan; also return how many holes."""
    total = 0
    for _ in range(4):
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
    """Return True for a mesh that is closed, consistently wound, and encloses a volume."""
    return bool(
        len(mesh.faces) >= 4 and mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    )


def is_sound(mesh: trimesh.Trimesh) -> bool:
    """Return True where a solid's volume, centre of mass and inertia are those of some real body within it.

    A surface that crosses itself may be closed and yet enclose parts twice or inside out.
    """
    if not is_solid(mesh):
        return False
    hull = mesh.convex_hull
    centre, low = np.array(mesh.center_mass), 1e-6 * float(mesh.extents.max())
    outside = ((centre - hull.triangles[:, 0]) * hull.face_normals).sum(axis=1).max()
    a, b, c = np.linalg.eigvalsh(mesh.moment_inertia)
    return bool(mesh.volume <= 1.001 * hull.volume and outside < low and a > 0 and a + b >= 0.9999 * c)
