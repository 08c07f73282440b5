"""Evenly spread points of a surface, with the normals of their faces."""

import heapq
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from dexgrasp_env.arrays import Array, Index, Mask
from dexgrasp_env.compiled import njit


class SurfaceSamples(NamedTuple):
    """Points of a surface.

    Attributes:
        points: (n, 3) [m].
        normals: (n, 3) outward unit normals of their faces.
    """

    points: Array
    normals: Array


def triangle_samples(triangles: Array, n: int, rng: np.random.Generator | int) -> SurfaceSamples:
    """Return exactly n blue-noise points of triangles, the same for the same seed.

    Of five times as many uniform points the most crowded is removed until n are left (Yuksel, Sample
    elimination for generating Poisson disk sample sets, 2015). Points on opposite sides of a thin wall do
    not crowd each other.

    Args:
        triangles: (F, 3, 3) [m], finite, some with an area.
        n: number of points, at least 1.
        rng: generator or seed.
    """
    normals, areas = _face_data(triangles)
    points, faces = _place(triangles, areas, np.random.default_rng(rng).random((5 * n, 3)))
    # The radius of n discs packed as densely as can be (Yuksel, Eq. 1 for surfaces).
    reach = 2.0 * np.sqrt(areas.sum() / (2.0 * np.sqrt(3.0) * n))
    kept = _thin(points, normals[faces], n, reach)
    return SurfaceSamples(points[kept], normals[faces[kept]])


def lattice(triangles: Array, spacing: float) -> Array:
    """Return points (N, 3) m of triangles (F, 3, 3), corners and sides with them, no farther apart than `spacing` m."""
    found = []
    for corners in triangles:
        n = int(np.ceil(np.linalg.norm(np.ptp(corners, axis=0)) / spacing))
        i, j = np.nonzero(np.tri(n + 1))
        found.append(np.stack([j, i - j, n - i], axis=1) @ corners / n)
    return np.concatenate(found)


def _face_data(triangles: Array) -> tuple[Array, Array]:
    """Return unit normals (F, 3) and areas (F,) of triangles (F, 3, 3)."""
    sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    doubled = np.sqrt((sides * sides).sum(-1))
    return sides / np.where(doubled > 0, doubled, 1.0)[:, None], doubled / 2


def _place(triangles: Array, areas: Array, uniform: Array) -> tuple[Array, Index]:
    """Return the surface points (N, 3) and faces (N,) that uniform numbers (N, 3) in [0, 1) stand for."""
    cumulative = np.cumsum(areas)
    faces = np.minimum(
        np.searchsorted(cumulative, uniform[:, 0] * cumulative[-1], side="right"), len(areas) - 1
    )
    root = np.sqrt(uniform[:, 1:2])
    corners = triangles[faces]
    share = root * uniform[:, 2:3]
    return (1.0 - root) * corners[:, 0] + (root - share) * corners[:, 1] + share * corners[:, 2], faces


def _thin(points: Array, normals: Array, n: int, reach: float) -> Index:
    """Return the sorted indices of n points left when the most crowded of the others have been removed."""
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    pairs = pairs[(normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(-1) > -0.5]
    gaps = points[pairs[:, 0]] - points[pairs[:, 1]]
    crowding = np.maximum(1.0 - np.sqrt((gaps * gaps).sum(-1)) / reach, 0.0) ** 8
    graph = coo_array((crowding, pairs.T), shape=(len(points), len(points))).tocsr()
    graph += graph.T
    return np.flatnonzero(_eliminate(graph.indptr, graph.indices, graph.data, n))


@njit
def _eliminate(starts: Index, others: Index, crowding: Array, n: int) -> Mask:
    """Return which points stay (N,) bool; `starts`, `others`, `crowding` list each point's neighbours."""
    count = starts.shape[0] - 1
    weights, kept = np.zeros(count), np.ones(count, np.bool_)
    for i in range(count):
        for e in range(starts[i], starts[i + 1]):
            weights[i] += crowding[e]
    heap = [(-weights[i], i) for i in range(count)]
    heapq.heapify(heap)
    left = count
    while left > n:
        weight, i = heapq.heappop(heap)
        if not kept[i] or weight != -weights[i]:  # an entry from before its neighbour went
            continue
        kept[i], left = False, left - 1
        for e in range(starts[i], starts[i + 1]):
            other = others[e]
            if kept[other]:
                weights[other] -= crowding[e]
                heapq.heappush(heap, (-weights[other], other))
    return kept
