"""The shapes that are shown: smooth shells around the robot's frames, written as `assets/robot/shells/*.obj`.

Each shell is a signed distance function, a smooth union of rounded primitives in the frame of its body.
Collision uses none of them. Run `python scripts/make_shells.py assets/robot/shells` to make them anew.
"""

import math
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

Point = tuple[float, float, float]
Field = Callable[[float, float, float], float]


def bar(a: Point, b: Point, radius: float, edge: float = 0.01, end_radius: float | None = None) -> Field:
    """A cylinder from a to b with rounded edges, conical where `end_radius` is given; m, negative inside."""
    length = math.dist(a, b)
    ux, uy, uz = ((q - p) / length for p, q in zip(a, b, strict=True))
    slope = 0.0 if end_radius is None else (end_radius - radius) / length

    def field(x: float, y: float, z: float) -> float:
        x, y, z = x - a[0], y - a[1], z - a[2]
        t = x * ux + y * uy + z * uz
        across = math.sqrt(max(x * x + y * y + z * z - t * t, 0.0))
        here = radius + slope * min(max(t, 0.0), length)
        return _rounded(across - here, abs(t - length / 2) - length / 2, -1.0, edge)

    return field


def block(center: Point, half: Point, edge: float) -> Field:
    """A box with rounded edges; metres, negative inside."""

    def field(x: float, y: float, z: float) -> float:
        return _rounded(
            abs(x - center[0]) - half[0], abs(y - center[1]) - half[1], abs(z - center[2]) - half[2], edge
        )

    return field


def blend(fields: list[Field], k: float) -> Field:
    """The union of the fields with fillets of about k metres."""

    def field(x: float, y: float, z: float) -> float:
        value = fields[0](x, y, z)
        for other in fields[1:]:
            d = other(x, y, z)
            h = max(k - abs(value - d), 0.0) / k
            value = min(value, d) - h * h * k / 4
        return value

    return field


def _rounded(a: float, b: float, c: float, edge: float) -> float:
    a, b, c = a + edge, b + edge, c + edge if c > -1.0 else -1.0
    outside = math.sqrt(max(a, 0.0) ** 2 + max(b, 0.0) ** 2 + max(c, 0.0) ** 2)
    return outside + min(max(a, b, c), 0.0) - edge


ARM: dict[str, Field] = {
    "panda_link0": blend(
        [
            bar((0, 0, 0.0), (0, 0, 0.14), 0.092, 0.01, 0.062),
            block((-0.07, 0, 0.045), (0.065, 0.055, 0.042), 0.018),
            bar((0.02, 0, 0.0), (0.02, 0, 0.022), 0.088, 0.008),
        ],
        0.04,
    ),
    "panda_link1": blend(
        [bar((0, 0, -0.19), (0, 0, -0.02), 0.058, 0.006), bar((0, -0.073, 0), (0, -0.002, 0), 0.061, 0.012)],
        0.03,
    ),
    "panda_link2": blend(
        [bar((0, -0.19, 0), (0, -0.02, 0), 0.058, 0.006), bar((0, 0, 0.002), (0, 0, 0.073), 0.061, 0.012)],
        0.03,
    ),
    "panda_link3": blend(
        [
            bar((0, 0, -0.123), (0, 0, -0.05), 0.058, 0.006),
            bar((0.0825, 0.002, 0), (0.0825, 0.072, 0), 0.056, 0.012),
            bar((0.005, 0.012, -0.045), (0.06, 0.015, -0.01), 0.042, 0.02),
        ],
        0.03,
    ),
    "panda_link4": blend(
        [
            bar((0, 0, 0.002), (0, 0, 0.072), 0.056, 0.012),
            bar((-0.0825, 0.05, 0), (-0.0825, 0.123, 0), 0.058, 0.006),
            bar((-0.02, 0.01, 0.015), (-0.0775, 0.05, 0.012), 0.042, 0.02),
        ],
        0.03,
    ),
    "panda_link5": blend(
        [
            bar((0, 0, -0.259), (0, 0, -0.18), 0.058, 0.006),
            bar((0, 0.035, -0.2), (0, 0.072, -0.06), 0.044, 0.02, 0.034),
            bar((0, 0.062, 0), (0, 0.105, 0), 0.046, 0.012),
            bar((0, 0.08, -0.06), (0, 0.083, 0), 0.035, 0.015),
        ],
        0.045,
    ),
    "panda_link6": blend(
        [
            bar((0, 0, -0.054), (0, 0, 0.054), 0.047, 0.012),
            bar((0.01, 0, 0.0), (0.07, 0, 0.0), 0.042, 0.015),
            bar((0.088, 0.057, 0), (0.088, -0.047, 0), 0.046, 0.01),
        ],
        0.025,
    ),
    "panda_link7": blend(
        [
            bar((0, 0, 0.05), (0, 0, 0.098), 0.045, 0.008),
            bar((0.02, 0.02, 0.072), (0.04, 0.04, 0.072), 0.02, 0.008),
        ],
        0.02,
    ),
}
"""Shells of the arm's links, in their frames."""


def _finger_link(length: float) -> Field:
    return block((0, 0, length / 2), (0.0096, 0.0135, length / 2 - 0.001), 0.0035)


HAND: dict[str, Field] = {
    "allegro_palm": block((-0.0093, 0, -0.0475), (0.0203, 0.0564, 0.0474), 0.007),
    "allegro_palm_pad": block((0.0105, 0, -0.0475), (0.0030, 0.045, 0.036), 0.0025),
    "allegro_base": _finger_link(0.0164),
    "allegro_proximal": _finger_link(0.054),
    "allegro_medial": _finger_link(0.0384),
    "allegro_distal": _finger_link(0.018),
    "allegro_thumb_base": block((-0.0179, 0.005, 0.02275), (0.0178, 0.0169, 0.0226), 0.005),
    "allegro_thumb_proximal": _finger_link(0.0177),
    "allegro_thumb_medial": _finger_link(0.0514),
    "allegro_thumb_distal": _finger_link(0.0330),
}
"""Shells of the hand's links, in their frames."""


def mesh_field(field: Field, step: float, faces: int) -> tuple[np.ndarray, np.ndarray]:
    """Mesh the zero surface of a field.

    Args:
        field: signed distance within 0.4 m of the origin, m.
        step: edge length of the lattice, m.
        faces: about how many triangles to keep.

    Returns:
        Vertices (n, 3) in m and triangles (m, 3), outward.
    """
    import fast_simplification
    from manifold3d import Manifold

    bounds = _bounds(field)
    solid = Manifold.level_set(lambda x, y, z: -field(x, y, z), bounds, step)
    mesh = solid.to_mesh()
    points = np.array(mesh.vert_properties[:, :3], dtype=np.float64)
    triangles = np.array(mesh.tri_verts, dtype=np.int32)
    if len(triangles) > faces:
        points, triangles = fast_simplification.simplify(points, triangles, target_count=faces, agg=3)
    return points, triangles


def _bounds(field: Field) -> list[float]:
    """The box that holds the surface, found on a coarse lattice, with a margin of 2 cm."""
    ticks = np.arange(-0.4, 0.4, 0.02)
    near = np.array([(x, y, z) for x in ticks for y in ticks for z in ticks if field(x, y, z) < 0.01])
    return [*(near.min(0) - 0.02), *(near.max(0) + 0.02)]


def write_obj(path: Path, points: np.ndarray, triangles: np.ndarray) -> None:
    """Write a mesh with vertices to 10 micrometres."""
    lines = [f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in points]
    lines += [f"f {a} {b} {c}" for a, b, c in triangles + 1]
    path.write_text("\n".join(lines) + "\n")


def write_shells(directory: Path) -> None:
    """Mesh every shell into `directory`."""
    for name, field in ARM.items():
        write_obj(directory / f"{name}.obj", *mesh_field(field, 0.005, 1800))
    for name, field in HAND.items():
        write_obj(directory / f"{name}.obj", *mesh_field(field, 0.002, 500))


if __name__ == "__main__":
    write_shells(Path(sys.argv[1]))
