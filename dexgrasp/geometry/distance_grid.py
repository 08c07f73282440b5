"""Distances tabled at the nodes of a grid: where thousands of points are asked for and a millimetre is good enough."""

from typing import NamedTuple

import numpy as np

from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp_env.arrays import Array, grid
from dexgrasp_env.compiled import njit

_SPACING = 0.015  # m


class Field(NamedTuple):
    """A signed distance at the nodes of a grid."""

    low: Array  # (3,) m, the first node
    spacing: float  # m
    values: Array  # (nx, ny, nz) m


def field_of(distance: ConvexDistance, low: Array, high: Array) -> Field:
    """Table a distance within a box from `low` to `high`, (3,) m both."""
    counts = np.ceil((high - low) / _SPACING).astype(int) + 1
    nodes = low + _SPACING * grid(*map(np.arange, counts))
    return Field(low, _SPACING, distance.distance(nodes).reshape(counts))


@njit
def field_at(field: Field, point: Array) -> float:
    """Return the distance, m, at a point (3,) between nodes; infinity beyond them."""
    cell, share = np.empty(3, np.int64), np.empty(3)
    for r in range(3):
        at = (point[r] - field.low[r]) / field.spacing
        cell[r] = int(np.floor(at))
        share[r] = at - cell[r]
        if cell[r] < 0 or cell[r] + 1 >= field.values.shape[r]:
            return np.inf
    value = 0.0
    for corner in range(8):
        weight, i, j, k = 1.0, corner & 1, (corner >> 1) & 1, corner >> 2
        weight *= share[0] if i else 1.0 - share[0]
        weight *= share[1] if j else 1.0 - share[1]
        weight *= share[2] if k else 1.0 - share[2]
        value += weight * field.values[cell[0] + i, cell[1] + j, cell[2] + k]
    return value
