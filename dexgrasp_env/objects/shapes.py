"""Parametric solids: watertight meshes with their convex parts, standing on z = 0, lengths in metres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dexgrasp_env.arrays import unit
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.loft import Section, loft_mesh, loft_parts
from dexgrasp_env.objects.parts import ContactPart, hull_part
from dexgrasp_env.poses import frame_of_z, matrix_to_quat

if TYPE_CHECKING:
    import manifold3d
    import trimesh


@dataclass(frozen=True, eq=False)
class Shape:
    """A solid: its watertight surface and the convex parts that stand for it in contact."""

    mesh: trimesh.Trimesh
    parts: tuple[ContactPart, ...]


def refined(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return the same surface cut into about 1800 triangles of about even size or more."""
    length = float(np.sqrt(mesh.area / 1800 * 4 / np.sqrt(3)))
    return from_manifold(to_manifold(mesh).refine_to_length(length))


def to_manifold(mesh: trimesh.Trimesh) -> manifold3d.Manifold:
    """Return the solid for boolean operations."""
    import manifold3d

    data = manifold3d.Mesh64(np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.uint64))
    return manifold3d.Manifold(data)


def from_manifold(solid: manifold3d.Manifold) -> trimesh.Trimesh:
    """Return the surface of a solid as a triangle mesh."""
    import trimesh

    data = solid.to_mesh64()
    mesh = trimesh.Trimesh(
        np.array(data.vert_properties)[:, :3], np.array(data.tri_verts, dtype=np.int64), process=False
    )
    welded = mesh.copy()
    welded.merge_vertices()
    return welded if welded.is_watertight else mesh  # vertices that nearly meet are not always one


def union(meshes: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
    """Return the union of watertight meshes."""
    import manifold3d

    return from_manifold(
        manifold3d.Manifold.batch_boolean([to_manifold(m) for m in meshes], manifold3d.OpType.Add)
    )


def loft(sections: Sequence[Section]) -> Shape:
    """A solid through cross-sections from the lowest to the highest."""
    return Shape(refined(loft_mesh(sections)), loft_parts(sections))


def revolve(profile: Sequence[tuple[float, float]]) -> Shape:
    """A body of revolution about z; `profile` is a list of (radius, height), upwards."""
    return loft([Section(z, r, r) for r, z in profile])


def box(size: Sequence[float]) -> Shape:
    """A box with sides `size` (3,)."""
    import trimesh

    half = np.asarray(size, dtype=float) / 2
    middle = np.array([0, 0, half[2]])
    mesh = trimesh.creation.box(2 * half).apply_translation(middle)
    return Shape(refined(mesh), (ContactPart("box", half, middle),))


def rounded_box(size: Sequence[float], corner: float, edge: float) -> Shape:
    """A box with upright edges rounded by `corner` and the edges of its ends by `edge`."""
    a, b, height = size[0] / 2, size[1] / 2, size[2]
    steps = [(edge * (1 - np.sin(t)), edge * (1 - np.cos(t))) for t in np.linspace(0, np.pi / 2, 4)]
    low = [Section(z, a - i, b - i, corner=corner) for i, z in steps]
    return loft(low + [Section(height - s.z, s.a, s.b, corner=corner) for s in reversed(low)])


def cylinder(diameter: float, height: float) -> Shape:
    """An upright cylinder."""
    return revolve([(diameter / 2, 0.0), (diameter / 2, height)])


def polyhedron(vertices: Sequence[Sequence[float]]) -> Shape:
    """The convex hull of `vertices` (n, 3)."""
    from trimesh.convex import convex_hull

    points = np.asarray(vertices, dtype=float)
    return Shape(refined(convex_hull(points)), (hull_part(points),))


def prism(polygon: Sequence[tuple[float, float]], thickness: float) -> Shape:
    """A convex polygon in the x-z plane, extruded along y about y = 0.

    Raises:
        InputError: if the polygon is not convex.
    """
    from scipy.spatial import ConvexHull

    points = np.asarray(polygon, dtype=float)
    if len(ConvexHull(points).vertices) < len(points):
        raise InputError("polygon of a prism is not convex: split it into convex ones")
    return polyhedron([(x, y, z) for x, z in points for y in (-thickness / 2, thickness / 2)])


def tetrahedron(edge: float) -> Shape:
    """A regular tetrahedron on one of its faces."""
    angle = np.pi / 2 + 2 * np.pi * np.arange(3) / 3
    radius = edge / np.sqrt(3)
    base = [(radius * np.cos(t), radius * np.sin(t), 0.0) for t in angle]
    return polyhedron([*base, (0.0, 0.0, edge * np.sqrt(2 / 3))])


def spiked_ball(diameter: float, spike: float, radius: float) -> Shape:
    """A ball with 32 round-ended rigid spikes, `spike` long and of `radius`; contact is exact."""
    import trimesh

    ball = diameter / 2
    centre = np.array([0.0, 0.0, ball + spike])
    half = (ball / 2 + spike - radius) / 2
    parts, solids = [ContactPart("sphere", np.array([ball, 0, 0]), centre)], []
    ico = trimesh.creation.icosahedron()
    for direction in unit(np.concatenate([ico.vertices, ico.triangles_center])):
        quat, middle = matrix_to_quat(frame_of_z(direction)), centre + direction * (ball / 2 + half)
        parts.append(ContactPart("capsule", np.array([radius, half, 0]), middle, quat))
        pin = trimesh.creation.capsule(height=2 * half, radius=radius, count=[8, 8])
        pin.apply_translation([0, 0, -pin.bounds.mean(axis=0)[2]])
        pin.apply_transform(trimesh.transformations.quaternion_matrix(quat))
        solids.append(pin.apply_translation(middle))
    core = trimesh.creation.icosphere(3, ball).apply_translation(centre)
    return Shape(union([core, *solids]), tuple(parts))


def brick_tower(side: float, height: float, bricks: int, stud: float) -> Shape:
    """A tower of square bricks with four studs on top and a shallow seam between bricks.

    The seams are in the surface only: contact is one box and four cylinders.
    """
    import trimesh

    body, seam = height - stud, 4e-4
    layer = body / bricks
    solids = [_block(side - 2 * seam, 0.0, body)]
    solids += [
        _block(side, i * layer + seam * (i > 0), (i + 1) * layer - seam * (i < bricks - 1))
        for i in range(bricks)
    ]
    parts = [ContactPart("box", np.array([side, side, body]) / 2, np.array([0, 0, body / 2]))]
    for x in (-side / 4, side / 4):
        for y in (-side / 4, side / 4):
            pin = trimesh.creation.cylinder(radius=side * 0.15, height=2 * stud, sections=24)
            solids.append(pin.apply_translation([x, y, body]))
            parts.append(
                ContactPart(
                    "cylinder", np.array([side * 0.15, stud / 2, 0]), np.array([x, y, body + stud / 2])
                )
            )
    return Shape(refined(union(solids)), tuple(parts))


def _block(side: float, low: float, high: float) -> trimesh.Trimesh:
    import trimesh

    return trimesh.creation.box((side, side, high - low)).apply_translation([0, 0, (low + high) / 2])
