"""Signed distance fields of the robot's shells (shells.yaml), m, negative inside."""

import math
from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np

Field = Callable[[float, float, float], float]


def shell(fillet: float = 1.0, *, of: list[dict[str, Any]]) -> Field:
    """Return the smooth union of rounded bars and blocks, with fillets of about so many metres."""
    fields = [_bar(**part) if "bar" in part else _block(**part) for part in of]

    def union(value: float, other: float) -> float:
        """Return the distance to two parts, blended where they meet."""
        h = max(fillet - abs(value - other), 0.0) / fillet
        return min(value, other) - h * h * fillet / 4

    return lambda x, y, z: reduce(union, (field(x, y, z) for field in fields))


def _bar(bar: Any, radius: float, edge: float, end_radius: float | None = None) -> Field:
    a, b = map(np.array, bar)
    length = math.dist(a, b)
    ux, uy, uz = ((b - a) / length).tolist()
    slope = 0.0 if end_radius is None else (end_radius - radius) / length

    def field(x: float, y: float, z: float) -> float:
        """Return the signed distance of a place."""
        x, y, z = x - a[0], y - a[1], z - a[2]
        t = x * ux + y * uy + z * uz
        across = math.sqrt(max(x * x + y * y + z * z - t * t, 0.0))
        return _rounded(
            edge, across - radius - slope * min(max(t, 0.0), length), abs(t - length / 2) - length / 2
        )

    return field


def _block(block: Any, edge: float) -> Field:
    centre, half = block
    return lambda *place: _rounded(
        edge, *(abs(v - c) - h for v, c, h in zip(place, centre, half, strict=True))
    )


def _rounded(edge: float, *sides: float) -> float:
    return math.hypot(*(max(side + edge, 0.0) for side in sides)) + min(max(sides) + edge, 0.0) - edge
