"""The shapes that are shown: smooth shells around the robot's frames, of shells.yaml, as `assets/robot/shells/*.obj`.

    python scripts/make_shells.py assets/robot/shells

Each shell is a signed distance function, a smooth union of rounded primitives in the frame of its body. Collision uses
none of them.
"""

import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from set_files import obj_of

SHELLS = Path(__file__).with_name("shells.yaml")
Point = tuple[float, float, float]
Field = Callable[[float, float, float], float]


def bar(a: Point, b: Point, radius: float, edge: float = 0.01, end_radius: float | None = None) -> Field:
    """A cylinder from a to b with rounded edges, conical where `end_radius` is given; m, negative inside."""
    length = math.dist(a, b)
    ux, uy, uz = ((q - p) / length for p, q in zip(a, b, strict=True))
    slope = 0.0 if end_radius is None else (end_radius - radius) / length

    def field(x: float, y: float, z: float) -> float:
        """Return the signed distance of a place, m, negative inside."""
        x, y, z = x - a[0], y - a[1], z - a[2]
        t = x * ux + y * uy + z * uz
        across = math.sqrt(max(x * x + y * y + z * z - t * t, 0.0))
        here = radius + slope * min(max(t, 0.0), length)
        return _rounded(across - here, abs(t - length / 2) - length / 2, -1.0, edge)

    return field


def block(center: Point, half: Point, edge: float) -> Field:
    """A box with rounded edges; metres, negative inside."""

    def field(x: float, y: float, z: float) -> float:
        """Return the signed distance of a place, m, negative inside."""
        return _rounded(
            abs(x - center[0]) - half[0], abs(y - center[1]) - half[1], abs(z - center[2]) - half[2], edge
        )

    return field


def blend(fields: list[Field], k: float) -> Field:
    """The union of the fields with fillets of about k metres."""

    def field(x: float, y: float, z: float) -> float:
        """Return the signed distance of a place, m, negative inside."""
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


def shell(fillet: float = 1.0, *, of: list[dict[str, Any]]) -> Field:
    """Return the field of a shell as shells.yaml has it."""
    fields = []
    for part in of:
        if "bar" in part:
            fields.append(bar(*part["bar"], part["radius"], part["edge"], part.get("end_radius")))
        else:
            fields.append(block(*part["block"], part["edge"]))
    return blend(fields, fillet)


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


def write_shells(directory: Path) -> None:
    """Mesh every shell into `directory`."""
    shells = yaml.safe_load(SHELLS.read_text())
    for part, step, faces in (("arm", 0.005, 1800), ("hand", 0.002, 500)):
        for name, content in shells[part].items():
            (directory / f"{name}.obj").write_bytes(obj_of(*mesh_field(shell(**content), step, faces)))


if __name__ == "__main__":
    write_shells(Path(sys.argv[1]))
