"""Length of a push before a contact force leaves its friction cone: followed along rays, many directions at once."""

import numpy as np

from dexgrasp.grasp.verify.cones import slides
from dexgrasp_env.arrays import Array, fibonacci_directions, unit


def least_way(forces: Array, answer: Array, normals: Array, mu: float) -> float:
    """Return the least way that forces go with a push, in any direction, until one leaves its cone.

    Args:
        forces: (N, c) N, within their cones.
        answer: (c N, 3), what a push of one unit along x, y, z adds to them.
        normals: (N, 3) unit, out of the object.
        mu: friction coefficient.

    Returns:
        The way in units of the push.
    """
    directions, reach, least = fibonacci_directions(1500), 0.12, np.inf
    spread = fibonacci_directions(80)
    for _ in range(9):  # each time closer about the best
        ways = _ways(forces, np.einsum("ij,kj->ki", answer, directions), normals, mu)
        least = min(least, float(ways.min()))
        best = directions[np.argsort(ways)[:5]]
        directions = unit((best[:, None] + reach * spread[None]).reshape(-1, 3))
        reach *= 0.4
    return least


def _ways(forces: Array, moves: Array, normals: Array, mu: float) -> Array:
    """Return (K,) how often moves (K, c N) can be added to forces (N, c) until one leaves its cone, by halving."""
    moves = moves.reshape(-1, *forces.shape)
    low, high = np.zeros(len(moves)), np.full(len(moves), 1e3)  # no hand bears as many
    for _ in range(40):
        middle = 0.5 * (low + high)
        press, sliding = slides(forces + middle[:, None, None] * moves, normals)
        inside = (sliding <= mu * press).all(1)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return low
