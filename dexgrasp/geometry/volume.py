"""Volume and centroid of a closed surface."""

import numpy as np

from dexgrasp_env.arrays import Array


def volume_and_centre(triangles: Array) -> tuple[float, Array]:
    """Return the volume, m3, and its centroid (3,) m, of what closed triangles (F, 3, 3) m enclose.

    By the divergence theorem (Eberly, Polyhedral mass properties, 2002); the triangles are counter-clockwise seen from
    outside. The sums are those of trimesh, to the last bit.
    """
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    sides = np.cross(b - a, c - b)
    first = a + b + c
    second = a**2 + b**2 + a * b + c * first
    volume = (sides[:, 0] * first[:, 0]).sum() / 6.0
    moments = np.ascontiguousarray((sides * second).T).sum(axis=1) / 24.0
    return float(volume), moments / volume
