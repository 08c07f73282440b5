"""Angle-weighted pseudonormals: the sign of a distance, right also at sharp edges and vertices.

Baerentzen and Aanaes, Signed distance computation using the angle weighted pseudonormal, 2005.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray


def pseudonormals(vertices: NDArray[Any], faces: NDArray[Any]) -> NDArray[Any]:
    """Return the unit pseudonormals (F, 7, 3) of each face, its edges 01, 12, 20 and its vertices 0, 1, 2.

    The second axis is the feature code of `triangle.FACE_CODE`.

    Args:
        vertices: (V, 3) welded vertices.
        faces: (F, 3) vertex indices.
    """
    corners = vertices[faces]
    sides = np.roll(corners, -1, axis=1) - corners
    flat = _unit(np.cross(sides[:, 0], sides[:, 1]))
    along = _unit(sides)
    angles = np.arccos(np.clip(-(along * np.roll(along, 1, axis=1)).sum(-1), -1.0, 1.0))
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], -1).reshape(-1, 2), axis=1)
    _, edges = np.unique(ends[:, 0] * len(vertices) + ends[:, 1], return_inverse=True)
    edges = edges.reshape(-1)
    at_edges = _gather(edges, np.repeat(flat, 3, axis=0))
    at_vertices = _gather(faces.reshape(-1), (angles[:, :, None] * flat[:, None]).reshape(-1, 3))
    shape = (len(faces), 3, 3)
    edge_part, vertex_part = at_edges[edges].reshape(shape), at_vertices[faces.reshape(-1)].reshape(shape)
    return np.concatenate([flat[:, None], edge_part, vertex_part], axis=1)


def _gather(index: NDArray[Any], vectors: NDArray[Any]) -> NDArray[Any]:
    """Return the unit sums of the vectors (N, 3) with equal index (N,)."""
    return _unit(np.stack([np.bincount(index, vectors[:, k]) for k in range(3)], axis=-1))


def _unit(vectors: NDArray[Any]) -> NDArray[Any]:
    """Return vectors scaled to length 1; zeros stay."""
    lengths = np.sqrt((vectors * vectors).sum(-1, keepdims=True))
    return vectors / np.where(lengths > 0, lengths, 1.0)


@njit(cache=True, error_model="numpy")
def signed(
    px: float,
    py: float,
    pz: float,
    squared: float,
    cx: float,
    cy: float,
    cz: float,
    normal: NDArray[Any],
    out: NDArray[Any],
) -> float:
    """Return the signed distance to the closest point c with pseudonormal (3,); write the gradient (3,)."""
    dx, dy, dz = px - cx, py - cy, pz - cz
    distance = math.sqrt(squared)
    if dx * normal[0] + dy * normal[1] + dz * normal[2] < 0.0:
        distance = -distance
    if squared > 1e-24:
        out[0], out[1], out[2] = dx / distance, dy / distance, dz / distance
    else:  # on the surface the direction is rounding
        out[0], out[1], out[2] = normal[0], normal[1], normal[2]
    return distance
