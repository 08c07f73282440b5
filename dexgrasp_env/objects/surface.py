"""Triangle surfaces: welded, simplified, judged."""

import numpy as np
import trimesh


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
