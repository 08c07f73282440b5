"""Solids from a stack of horizontal cross-sections, with their convex parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.objects.parts import MAX_VERTICES, ContactPart, hull_part

if TYPE_CHECKING:
    import trimesh

_SIDES = 40
_TOLERANCE = 5e-4
_PART_SIDES = (32, 24, 20, 16)


@dataclass(frozen=True)
class Section:
    """One cross-section, centred on the z axis.

    Attributes:
        z: height in metres.
        a: half width along x, metres; 0 with `b` 0 is a tip.
        b: half width along y, metres.
        exponent: of the superellipse |x/a|^n + |y/b|^n = 1; 2 is an ellipse, more is squarer.
        corner: if given, a rectangle with corners of this radius in metres takes the superellipse's place.
    """

    z: float
    a: float
    b: float
    exponent: float = 2.0
    corner: float | None = None

    @property
    def is_circle(self) -> bool:
        """Return True for a circular section."""
        return self.a == self.b and self.exponent == 2.0 and self.corner is None

    def ring(self, count: int) -> Array:
        """Return (count, 3) points around the section; `count` is a multiple of 4."""
        x, y = self._rounded_rectangle(count) if self.corner is not None else self._superellipse(count)
        return np.stack([x, y, np.full(count, self.z)], axis=-1)

    def _superellipse(self, count: int) -> tuple[Array, Array]:
        angle = 2 * np.pi * np.arange(count) / count
        power = 2.0 / self.exponent
        x, y = (part.round(12) for part in (np.cos(angle), np.sin(angle)))
        return self.a * np.sign(x) * np.abs(x) ** power, self.b * np.sign(y) * np.abs(y) ** power

    def _rounded_rectangle(self, count: int) -> tuple[Array, Array]:
        r = min(self.corner or 0.0, self.a, self.b)
        quarter = np.linspace(0.0, np.pi / 2, count // 4)
        angle = (quarter + np.arange(4)[:, None] * np.pi / 2).ravel()
        sign_x = np.repeat([1, -1, -1, 1], count // 4)
        sign_y = np.repeat([1, 1, -1, -1], count // 4)
        return sign_x * (self.a - r) + r * np.cos(angle), sign_y * (self.b - r) + r * np.sin(angle)


def loft_mesh(sections: Sequence[Section]) -> trimesh.Trimesh:
    """Return the watertight skin over `sections`, given from the lowest to the highest."""
    import trimesh

    rings = np.concatenate([section.ring(_SIDES) for section in sections])
    vertices = np.concatenate([rings, [[0, 0, sections[0].z], [0, 0, sections[-1].z]]])
    here = np.arange(len(rings)).reshape(-1, _SIDES)
    after = np.roll(here, -1, axis=1)
    corners = [(here[:-1], after[:-1], after[1:]), (here[:-1], after[1:], here[1:])]
    wall = np.array(corners).transpose(2, 0, 3, 1).reshape(-1, 3)  # level by level
    ends = [(len(rings), after[0], here[0]), (len(rings) + 1, here[-1], after[-1])]
    fans = [np.stack(np.broadcast_arrays(*end), axis=-1) for end in ends]
    mesh = trimesh.Trimesh(vertices, np.concatenate([wall, *fans]), process=False)
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces(height=1e-12))
    mesh.remove_unreferenced_vertices()
    return mesh


def loft_parts(sections: Sequence[Section]) -> tuple[ContactPart, ...]:
    """Split a loft at its concave places into convex parts that stand out by at most half a millimetre.

    Long circular stretches become cylinders, the rest convex meshes of at most `MAX_VERTICES` vertices.
    """
    parts = []
    start = 0
    while start < len(sections) - 1:
        end = _run_end(sections, start)
        if sections[end].z - sections[start].z > 1e-6:
            parts.append(_run_part(sections[start : end + 1]))
        start = end
    return tuple(parts)


def _is_pillar(low: Section, high: Section) -> bool:
    """Return True for a stretch that is a circular cylinder at least as long as its radius."""
    return low.is_circle and high.is_circle and low.a == high.a and high.z - low.z >= low.a


def _run_end(sections: Sequence[Section], start: int) -> int:
    """Index of the last section of the longest convex run from `start`."""
    end = start + 1
    if _is_pillar(*sections[start : end + 1]) or sections[start].z == sections[end].z:
        return end
    while end + 1 < len(sections) and not (
        _is_pillar(*sections[end : end + 2]) or _bulge(sections[start : end + 2]) > _TOLERANCE
    ):
        end += 1
    return end


def _bulge(sections: Sequence[Section]) -> float:
    """Depth in metres of the deepest place of a loft's skin under its convex hull."""
    from scipy.spatial import ConvexHull

    rings = np.stack([section.ring(24) for section in sections])
    if np.ptp(rings[..., 2]) < 1e-9:
        return 0.0
    skin = np.concatenate([(1 - s) * rings[:-1] + s * rings[1:] for s in (0.0, 0.1, 0.5, 0.9, 1.0)]).reshape(
        -1, 3
    )
    planes = ConvexHull(rings.reshape(-1, 3), qhull_options="QJ Pp").equations
    depth = -(skin @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    return float(depth.max())


def _run_part(run: Sequence[Section]) -> ContactPart:
    kept = _thinned(list(run))
    low, high = kept[0], kept[-1]
    if len(kept) == 2 and low.is_circle and high.is_circle and low.a == high.a:
        middle = np.array([0.0, 0.0, (low.z + high.z) / 2])
        return ContactPart("cylinder", np.array([low.a, (high.z - low.z) / 2, 0.0]), middle)
    sides = next((n for n in _PART_SIDES if n * len(kept) <= MAX_VERTICES), _PART_SIDES[-1])
    return hull_part(np.concatenate([_mean_ring(section, sides) for section in kept]))


def _mean_ring(section: Section, sides: int) -> Array:
    """A ring whose polygon lies as far outside a circle at its corners as inside it between them."""
    if section.a == 0:
        return section.ring(4)[:1]
    ring = section.ring(sides)
    if section.is_circle:
        ring[:, :2] *= 2.0 / (1.0 + np.cos(np.pi / sides))
    return ring


def _thinned(sections: list[Section]) -> list[Section]:
    """Leave out the sections that matter least, until the part has few enough vertices."""
    most = MAX_VERTICES // _PART_SIDES[-1]
    while len(sections) > 2:
        losses = [_loss(*sections[i - 1 : i + 2]) for i in range(1, len(sections) - 1)]
        least = int(np.argmin(losses))
        if losses[least] > _TOLERANCE / 5 and len(sections) <= most:
            break
        del sections[least + 1]
    return sections


def _loss(low: Section, middle: Section, high: Section) -> float:
    """Return the distance in metres of the middle section from the line between its neighbours."""
    p, q, r = (np.array([s.a + s.b, 2 * s.z]) / 2 for s in (low, middle, high))
    along = (r - p) / max(float(np.hypot(*(r - p))), 1e-12)
    return float(abs(along[0] * (q - p)[1] - along[1] * (q - p)[0]))
