"""How far a push goes before a contact force leaves its friction cone: followed along rays, many directions at once."""

import numpy as np

from dexgrasp_env.arrays import Array

_RAYS, _NEAR = 1500, 80  # directions at first, and about each of the best
_NARROWINGS, _BEST, _REACH = 8, 5, 0.12


def least_way(forces: Array, answer: Array, normals: Array, mu: float) -> float:
    """Return the least way that forces go with a push, in any direction, until one leaves its cone.

    Args:
        forces: (N, 3) N, within their cones.
        answer: (3 N, 3), what a push of one unit along x, y, z adds to them.
        normals: (N, 3) unit, out of the object.
        mu: friction coefficient.

    Returns:
        The way in units of the push.
    """
    directions, reach, least = _sphere(_RAYS), _REACH, np.inf
    spread = _sphere(_NEAR)
    for _ in range(_NARROWINGS + 1):
        ways = _ways(forces, np.einsum("ij,kj->ki", answer, directions), normals, mu)
        least = min(least, float(ways.min()))
        best = directions[np.argsort(ways)[:_BEST]]
        directions = (best[:, None] + reach * spread[None]).reshape(-1, 3)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        reach *= 0.4
    return least


def _ways(f: Array, moves: Array, normals: Array, mu: float) -> Array:
    """Return (K,) how often moves (K, 3 N) can be added to forces (N, 3) until one leaves its cone."""
    d = moves.reshape(len(moves), -1, 3)
    p0, p1 = -(f * normals).sum(-1), -(d * normals).sum(-1)
    t0, t1 = f + p0[:, None] * normals, d + p1[..., None] * normals
    a = (t1 * t1).sum(-1) - mu**2 * p1**2
    b = (t0 * t1).sum(-1) - mu**2 * p0 * p1
    c = np.minimum((t0 * t0).sum(-1) - mu**2 * p0**2, 0.0)
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    # c <= 0 within the cone, so the first way out is the positive root, written without cancellation.
    with np.errstate(divide="ignore", invalid="ignore"):
        way = np.where(b + root > 0.0, -c / (b + root), np.where(a > 0.0, (root - b) / a, np.inf))
    return np.nan_to_num(way, nan=0.0, posinf=1e9).min(1)


def _sphere(count: int) -> Array:
    """Evenly spread unit vectors (count, 3)."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + 5.0**0.5) * k
    return np.stack([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z], 1)
