"""The closest point of a triangle, and which of its features holds it; the way across two vectors."""

from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import leaf

FACE, EDGE, VERTEX = 0, 1, 4
"""Codes of a triangle's features: its inside; the first of its edges 01, 12, 20; the first of its vertices 0, 1, 2."""


@leaf
def cross(a: Array, b: Array, out: Array) -> None:
    """Write a x b, (3,)."""
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@leaf
def closest_on_triangle(px: float, py: float, pz: float, triangle: Array) -> tuple[float, float, float, int]:
    """Return the point of a triangle closest to p and the code of the feature that holds it.

    Voronoi regions in the order of Ericson, Real-Time Collision Detection (2005), section 5.1.5.

    Args:
        px, py, pz: the point.
        triangle: (3, 3) corners.

    Returns:
        x, y, z of the closest point and its feature code (see `VERTEX`).
    """
    ax, ay, az = triangle[0, 0], triangle[0, 1], triangle[0, 2]
    ux, uy, uz = triangle[1, 0] - ax, triangle[1, 1] - ay, triangle[1, 2] - az
    vx, vy, vz = triangle[2, 0] - ax, triangle[2, 1] - ay, triangle[2, 2] - az
    wx, wy, wz = px - ax, py - ay, pz - az
    d1 = ux * wx + uy * wy + uz * wz
    d2 = vx * wx + vy * wy + vz * wz
    if d1 <= 0.0 and d2 <= 0.0:
        return ax, ay, az, 4
    uu = ux * ux + uy * uy + uz * uz
    uv = ux * vx + uy * vy + uz * vz
    vv = vx * vx + vy * vy + vz * vz
    d3, d4 = d1 - uu, d2 - uv
    if d3 >= 0.0 and d4 <= d3:
        return ax + ux, ay + uy, az + uz, 5
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        t = d1 / (d1 - d3)
        return ax + t * ux, ay + t * uy, az + t * uz, 1
    d5, d6 = d1 - uv, d2 - vv
    if d6 >= 0.0 and d5 <= d6:
        return ax + vx, ay + vy, az + vz, 6
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        t = d2 / (d2 - d6)
        return ax + t * vx, ay + t * vy, az + t * vz, 3
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 >= d3 and d5 >= d6:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return ax + ux + t * (vx - ux), ay + uy + t * (vy - uy), az + uz + t * (vz - uz), 2
    scale = 1.0 / (va + vb + vc)
    s, t = vb * scale, vc * scale
    return ax + s * ux + t * vx, ay + s * uy + t * vy, az + s * uz + t * vz, 0
