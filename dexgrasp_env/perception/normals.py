"""Normals, and noise averaged out over all views by local planes."""

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.perception.cloud import Cloud

_LEAST = 8  # points of a neighbourhood: with fewer the radius is doubled once


def smooth(cloud: Cloud, queries: Cloud, noise: float, radius: float = 0.010) -> tuple[Array, Array]:
    """Project points onto local planes of the fused cloud, one step of moving least squares.

    Points seen from near weigh more, as 1 / depth^4: noise grows with depth^2. Nothing is moved along the
    surface, nor by more than three times the noise, so that edges keep their place; without noise nothing
    moves (Alexa et al. 2003).

    Args:
        cloud: the fused points.
        queries: the points to move.
        noise: RMS noise along the rays, metres, as the table shows it.
        radius: of the neighbourhood, metres.

    Returns:
        Points (Q, 3) m and unit normals (Q, 3) towards the cameras.
    """
    centres, normals, residuals = _planes(cloud, queries, radius)
    offset = ((queries.points - centres) * normals).sum(-1)
    # Where the spread across the plane is more than noise, the surface is bent: trust the point more.
    bent = np.maximum(residuals**2 - noise**2, 0.0)
    share = noise**2 / np.maximum(noise**2 + bent, 1e-18)
    shift = np.clip(share * offset, -3.0 * noise, 3.0 * noise)
    return queries.points - shift[:, None] * normals, normals


def _planes(cloud: Cloud, queries: Cloud, radius: float) -> tuple[Array, Array, Array]:
    from dexgrasp_env.perception.kernels import local_planes

    points = np.ascontiguousarray(cloud.points)
    weights = cloud.depth**-4.0
    centres, normals, residuals = local_planes(
        np.ascontiguousarray(queries.points), points, weights, radius, _LEAST
    )
    facing = (normals * queries.views).sum(-1, keepdims=True)
    normals = np.where(facing < 0, -normals, normals)
    return centres, np.where((normals**2).sum(-1, keepdims=True) < 0.5, queries.views, normals), residuals
