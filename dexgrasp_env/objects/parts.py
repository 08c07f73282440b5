"""Convex contact geometry: what the simulator collides, in the frame of the object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import unknown_name
from dexgrasp_env.poses import quat_conjugate, rotate

if TYPE_CHECKING:
    import trimesh

KINDS = ("box", "cylinder", "sphere", "capsule", "ellipsoid", "mesh")
MAX_VERTICES = 100
"""Vertices a convex mesh part may have: collision time grows slowly up to about here."""


@dataclass(frozen=True, eq=False)
class ContactPart:
    """One convex piece of an object.

    Attributes:
        kind: one of `KINDS`.
        size: (3,) as MuJoCo has it, metres: half extents of a box; radius, half length, 0 of a cylinder or
            capsule (half length without the round ends); radius of a sphere; semi-axes of an ellipsoid;
            zeros for a mesh.
        position: (3,) metres, of the part's frame in the object frame.
        quat_wxyz: (4,) of the part's frame in the object frame.
        vertices: (n, 3) metres in the part's frame, for a mesh; empty otherwise.
    """

    kind: str
    size: Array = field(default_factory=lambda: np.zeros(3))
    position: Array = field(default_factory=lambda: np.zeros(3))
    quat_wxyz: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    vertices: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        """Make the arrays floating point and read-only."""
        if self.kind not in KINDS:
            raise unknown_name("contact part", self.kind, KINDS)
        for name in ("size", "position", "quat_wxyz", "vertices"):
            value = np.array(getattr(self, name), dtype=float)
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    def translated(self, offset: Array) -> ContactPart:
        """Return the part moved by `offset` (3,) in the object frame."""
        return replace(self, position=self.position + offset)

    def scaled(self, factor: float) -> ContactPart:
        """Return the part scaled about the origin of the object frame."""
        return replace(
            self, size=self.size * factor, position=self.position * factor, vertices=self.vertices * factor
        )

    def support(self, directions: Array) -> Array:
        """Furthest reach (...,) in metres along unit `directions` (..., 3) of the object frame."""
        local = rotate(quat_conjugate(self.quat_wxyz), np.asarray(directions, dtype=float))
        return (directions * self.position).sum(-1) + self._local_support(local)

    def _local_support(self, d: Array) -> Array:
        a, b, _ = self.size
        across = np.sqrt(d[..., 0] ** 2 + d[..., 1] ** 2)
        if self.kind == "box":
            return (np.abs(d) * self.size).sum(-1)
        if self.kind == "cylinder":
            return a * across + b * np.abs(d[..., 2])
        if self.kind == "capsule":
            return a + b * np.abs(d[..., 2])
        if self.kind == "sphere":
            return np.full(d.shape[:-1], a)
        if self.kind == "ellipsoid":
            return np.sqrt(((d * self.size) ** 2).sum(-1))
        return (d @ self.vertices.T).max(-1)

    def surface(self, detail: int = 3) -> trimesh.Trimesh:
        """Return a triangle mesh of the part in the object frame; round kinds from inside, finer with `detail`."""
        import trimesh

        local = trimesh.convex.convex_hull(_points(self, detail))
        return trimesh.Trimesh(rotate(self.quat_wxyz, local.vertices) + self.position, local.faces)


def _points(part: ContactPart, detail: int) -> Array:
    """Points in the part's frame whose hull is the part, or nearly so for round kinds."""
    import trimesh

    a, b, _ = part.size
    if part.kind == "mesh":
        return part.vertices
    if part.kind == "box":
        return trimesh.creation.box(2 * part.size).vertices
    if part.kind == "cylinder":
        return trimesh.creation.cylinder(a, 2 * b, sections=8 * 2**detail).vertices
    ball = trimesh.creation.icosphere(detail).vertices
    if part.kind == "ellipsoid":
        return ball * part.size
    lift = np.array([0.0, 0.0, b if part.kind == "capsule" else 0.0])
    return np.concatenate([a * ball + lift, a * ball - lift])


def hull_part(points: Array) -> ContactPart:
    """Return the convex hull of `points` (n, 3) as a mesh part with only the vertices that matter."""
    from scipy.spatial import ConvexHull

    return ContactPart("mesh", vertices=np.asarray(points)[np.sort(ConvexHull(points).vertices)])


def support_height(parts: Sequence[ContactPart], up: Array) -> float:
    """Height in metres of the object's origin over a plane it rests on, with normal `up` (3,)."""
    return float(max(part.support(-np.asarray(up)) for part in parts))
