"""Evenly spread points of a surface and smooth normals there."""

from __future__ import annotations

import heapq
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dexgrasp_env.errors import InputError

if TYPE_CHECKING:
    import trimesh

OVERSAMPLING = 5
"""Candidates a sample; more spread the samples more evenly and cost more."""


class SurfaceSamples(NamedTuple):
    """Points of a surface.

    Attributes:
        points: (n, 3) [m].
        normals: (n, 3) outward unit normals of their faces.
        faces: (n,) int64 face indices.
    """

    points: NDArray
    normals: NDArray
    faces: NDArray


def surface_samples(mesh: trimesh.Trimesh, n: int, rng: np.random.Generator | int) -> SurfaceSamples:
    """Return exactly n blue-noise points of a mesh, the same for the same seed.

    Of `OVERSAMPLING` n uniform points the most crowded is removed until n are left (Yuksel, Sample
    elimination for generating Poisson disk sample sets, 2015). Points on opposite sides of a thin wall do
    not crowd each other.

    Args:
        mesh: triangles [m].
        n: number of points, at least 1.
        rng: generator or seed.

    Raises:
        InputError: `n` below 1 or a mesh without area.
    """
    if n < 1:
        raise InputError(f"n is {n}: valid are integers of at least 1")
    triangles, normals, areas = _face_data(mesh)
    uniform = np.random.default_rng(rng).random((OVERSAMPLING * n, 3))
    points, faces = _place(triangles, areas, uniform)
    # The radius of n discs packed as densely as can be (Yuksel, Eq. 1 for surfaces).
    reach = 2.0 * np.sqrt(areas.sum() / (2.0 * np.sqrt(3.0) * n))
    kept = _thin(points, normals[faces], n, reach)
    return SurfaceSamples(points[kept], normals[faces[kept]], faces[kept])


def smooth_normals(
    mesh: trimesh.Trimesh, points: NDArray, normals: NDArray, radius: float, density: int = 24
) -> NDArray:
    """Return unit normals (n, 3) averaged over the surface within a radius of each point.

    Surface is weighted by its area, by (1 - (r / radius)^2)^2 and by the cosine between the normals where
    that is positive. Blunt edges and facets are smoothed; edges of 90 degrees stay sharp, and the far side
    of a thin wall does not count.

    Args:
        mesh: triangles [m].
        points: (n, 3) points of the surface [m].
        normals: (n, 3) outward unit normals of their faces.
        radius: [m], above 0.
        density: surface points looked at within the radius of a point of a flat surface.

    Raises:
        InputError: `radius` not above 0, or a mesh without area.
    """
    if not radius > 0:
        raise InputError(f"radius is {radius} m: valid are lengths above 0")
    triangles, flat, areas = _face_data(mesh)
    count = int(np.clip(density * areas.sum() / (np.pi * radius**2), 1000, 400_000))
    around, faces = _place(triangles, areas, _even(count))
    near = cKDTree(around).query_ball_point(points, radius, return_sorted=True)
    owner = np.repeat(np.arange(len(points)), [len(found) for found in near])
    index = np.concatenate([np.asarray(found, dtype=np.int64) for found in near])
    offsets = around[index] - points[owner]
    weights = (1.0 - (offsets * offsets).sum(-1) / radius**2) ** 2
    weights *= np.maximum((flat[faces[index]] * normals[owner]).sum(-1), 0.0)
    total = 1e-9 * normals  # alone where nothing lies within the radius
    for k in range(3):
        total[:, k] += np.bincount(owner, weights * flat[faces[index], k], len(points))
    return total / np.sqrt((total * total).sum(-1, keepdims=True))


def _face_data(mesh: trimesh.Trimesh) -> tuple[NDArray, NDArray, NDArray]:
    """Return triangles (F, 3, 3), unit normals (F, 3) and areas (F,)."""
    triangles = np.asarray(mesh.vertices, dtype=np.float64)[np.asarray(mesh.faces)]
    sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    doubled = np.sqrt((sides * sides).sum(-1))
    if not (len(doubled) and np.isfinite(doubled).all() and doubled.sum() > 0):
        raise InputError("the mesh is empty or not finite: valid are finite triangles that have area")
    return triangles, sides / np.where(doubled > 0, doubled, 1.0)[:, None], doubled / 2


def _place(triangles: NDArray, areas: NDArray, uniform: NDArray) -> tuple[NDArray, NDArray]:
    """Return the surface points (N, 3) and faces (N,) that uniform numbers (N, 3) in [0, 1) stand for."""
    cumulative = np.cumsum(areas)
    faces = np.searchsorted(cumulative, uniform[:, 0] * cumulative[-1], side="right")
    faces = np.minimum(faces, len(areas) - 1)
    root = np.sqrt(uniform[:, 1:2])
    corners = triangles[faces]
    share = root * uniform[:, 2:3]
    return (1.0 - root) * corners[:, 0] + (root - share) * corners[:, 1] + share * corners[:, 2], faces


def _even(count: int) -> NDArray:
    """Return numbers (count, 3) in [0, 1): equal shares of the area, and the R2 sequence within the faces."""
    index = np.arange(count)
    within = (0.5 + index[:, None] * np.array([0.7548776662466927, 0.5698402909980532])) % 1.0
    return np.column_stack([(index + 0.5) / count, within])


def _thin(points: NDArray, normals: NDArray, n: int, reach: float) -> NDArray:
    """Return the sorted indices of n points left when the most crowded of the others have been removed."""
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    pairs = pairs[(normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(-1) > -0.5]
    gaps = points[pairs[:, 0]] - points[pairs[:, 1]]
    crowding = np.maximum(1.0 - np.sqrt((gaps * gaps).sum(-1)) / reach, 0.0) ** 8
    ends, others = np.concatenate([pairs, pairs[:, ::-1]]).T
    order = np.lexsort((others, ends))
    starts = np.searchsorted(ends[order], np.arange(len(points) + 1))
    return np.flatnonzero(_eliminate(starts, others[order], np.concatenate([crowding, crowding])[order], n))


@njit(cache=True)
def _eliminate(starts: NDArray, others: NDArray, crowding: NDArray, n: int) -> NDArray:
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
