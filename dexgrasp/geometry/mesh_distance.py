"""Signed distance to a triangle mesh by trimesh: the measure in verification."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dexgrasp_env.arrays import Array

if TYPE_CHECKING:
    import trimesh


class Closest(NamedTuple):
    """Closest points of a surface to N points."""

    distances: Array
    """(N,) [m], negative inside."""
    points: Array
    """(N, 3) [m], on the surface."""
    gradients: Array
    """(N, 3) of the distance; unit vectors."""


def closest_on_mesh(mesh: "trimesh.Trimesh", points: ArrayLike) -> Closest:
    """Return signed distances, closest points and gradients.

    The sign is that of the angle-weighted pseudonormal of the closest face, edge or vertex, right also at
    sharp edges (Baerentzen and Aanaes, 2005). Where a mesh is open it says on which side of the nearest
    surface a point lies.

    Args:
        mesh: triangles [m], one at least.
        points: (N, 3) [m].
    """
    import trimesh

    queries = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    # trimesh takes squared distances within 1e-8 for equal: in metres that is 0.1 mm, in millimetres 0.1 um.
    scale = 1e3
    welded = trimesh.Trimesh(scale * np.asarray(mesh.vertices), mesh.faces, process=True)
    closest, _, faces = trimesh.proximity.closest_point(welded, scale * queries)
    shares = trimesh.triangles.points_to_barycentric(welded.triangles[faces], closest)
    normals = welded.face_normals[faces]
    corner = 1e-9  # a smaller barycentric coordinate is none: the closest point is of an edge or a vertex
    for k in np.flatnonzero((shares <= corner).any(1)):
        normals[k] = _pseudonormal(welded, welded.faces[faces[k]][shares[k] > corner])
    closest = closest / scale
    offsets = queries - closest
    lengths = np.sqrt((offsets * offsets).sum(-1))
    signed = np.where((offsets * normals).sum(-1) < 0.0, -lengths, lengths)
    far = lengths > 1e-12  # Below this distance [m] the direction to the closest point is rounding.
    gradients = np.where(far[:, None], offsets / np.where(far, signed, 1.0)[:, None], normals)
    return Closest(signed, closest, gradients)


def _pseudonormal(mesh: "trimesh.Trimesh", corners: Array) -> Array:
    """Return the unit pseudonormal (3,) of a vertex, or of the edge between two."""
    if len(corners) == 1:
        return mesh.vertex_normals[corners[0]]
    beside = np.isin(mesh.faces, corners).sum(1) == 2
    total = mesh.face_normals[beside].sum(0)
    return total / np.sqrt((total * total).sum())
