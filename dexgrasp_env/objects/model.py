"""An object as the rest of the project sees it: surface, contact parts and mass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from dexgrasp_env.arrays import Array, Index, fibonacci_directions
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import content_hash
from dexgrasp_env.objects.parts import ContactPart
from dexgrasp_env.robot.hulls import planes_of

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True, eq=False)
class Solid:
    """A watertight surface with its convex hull, metres; its trimesh is made when asked for, as the import takes long.

    Attributes:
        vertices: (N, 3).
        faces: (F, 3) indices of vertices.
        corners: (K, 3) of the convex hull.
        hull_centre: (3,) centroid of the hull's volume.
    """

    vertices: Array
    faces: Index
    corners: Array
    hull_centre: Array

    @classmethod
    def of(cls, mesh: trimesh.Trimesh) -> Solid:
        """Take a watertight mesh."""
        hull = mesh.convex_hull
        return cls(
            np.array(mesh.vertices, dtype=float), np.array(mesh.faces, dtype=np.int64),
            np.array(hull.vertices, dtype=float), np.array(hull.center_mass),
        )  # fmt: skip

    @cached_property
    def mesh(self) -> trimesh.Trimesh:
        """The surface as a triangle mesh."""
        import trimesh

        return trimesh.Trimesh(self.vertices, self.faces, process=False)

    def scaled(self, factor: float) -> Solid:
        """Return the surface scaled about the origin."""
        return Solid(factor * self.vertices, self.faces, factor * self.corners, factor * self.hull_centre)


@dataclass(frozen=True, eq=False)
class ObjectModel:
    """A rigid object; its frame has the origin at the centre of mass and the axes as built.

    Attributes:
        name: catalogue name, or the stem of a mesh file.
        solid: its watertight surface, object frame; `mesh` gives it as a trimesh.
        parts: convex pieces that the simulator collides.
        mass: kilograms.
        inertia: (3, 3) kg m^2 about the centre of mass, axes of the object frame. The mass is spread evenly
            over the volume of the mesh.
        friction: sliding coefficient of its contacts where the scene names none; None: the default.
        fixed_pose: (4,) wxyz of the one pose it is presented in, or None: then any of `rest_poses`.
        upright: (4,) wxyz of the pose it stands upright in; None: as built.
        rgba: colour it is drawn in.
        notes: what was done to it or assumed of it, one sentence each.
        file_centre: (3,) metres, where the origin lies in the frame of the mesh file; zero for the catalogue.
    """

    name: str
    solid: Solid
    parts: tuple[ContactPart, ...]
    mass: float
    inertia: Array
    friction: float | None = None
    fixed_pose: Array | None = None
    rgba: tuple[float, float, float, float] = (0.75, 0.55, 0.3, 1.0)
    notes: tuple[str, ...] = ()
    upright: Array | None = None
    file_centre: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        """Check what a simulator would trip over."""
        if not (np.isfinite(self.mass) and self.mass > 0):
            raise InputError(f"mass of {self.name} is {self.mass}: it must be a positive number of kilograms")
        if not self.parts:
            raise InputError(f"object {self.name} has no contact parts: give at least one convex part")

    @property
    def mesh(self) -> trimesh.Trimesh:
        """Watertight surface in metres, object frame."""
        return self.solid.mesh

    @cached_property
    def content_hash(self) -> str:
        """Hash of surface, contact parts, mass and friction (not of name, pose or colour)."""
        return content_hash(_microns(self.solid.vertices), self.solid.faces, self.contact_hash, self.friction)

    @cached_property
    def contact_hash(self) -> str:
        """Hash of contact parts, mass and inertia: all that decides how the object rests."""
        shapes: list[Any] = []
        for p in self.parts:
            shapes += [p.kind, *map(_microns, (p.size, p.position, p.quat_wxyz, p.vertices))]
        inertia = [f"{value:.4e}" for value in np.diag(self.inertia)]
        return content_hash(*shapes, f"{self.mass:.5e}", inertia)

    @cached_property
    def extents(self) -> Array:
        """(3,) metres, sides of the box around the mesh along the object's axes."""
        return np.ptp(self.solid.vertices, axis=0)

    @cached_property
    def hull(self) -> trimesh.Trimesh:
        """Convex hull of the mesh with at most 200 vertices, from inside."""
        return reduced_hull(self.solid.vertices, 200)

    def scaled(self, factor: float) -> ObjectModel:
        """Return a copy `factor` times as large in every direction, of the same density."""
        if factor == 1.0:
            return self
        return replace(
            self,
            solid=self.solid.scaled(factor),
            parts=tuple(part.scaled(factor) for part in self.parts),
            mass=self.mass * factor**3,
            inertia=self.inertia * factor**5,
            file_centre=self.file_centre * factor,
        )

    def with_mass(self, mass: float) -> ObjectModel:
        """Return a copy of another mass in kilograms, spread in the same way."""
        return replace(self, mass=mass, inertia=self.inertia * (mass / self.mass))


def centred_model(
    name: str,
    mesh: trimesh.Trimesh,
    parts: Sequence[ContactPart],
    mass: float,
    **more: Any,
) -> ObjectModel:
    """Return a model of mesh and parts in any frame, re-centred at the centre of mass, evenly filled.

    Args:
        name: what it is called.
        mesh: watertight surface, metres.
        parts: convex parts in the frame of the mesh.
        mass: kilograms.
        more: other attributes of `ObjectModel`.

    Raises:
        InputError: for a mesh that is not watertight.
    """
    if not mesh.is_watertight:
        raise InputError(f"mesh of {name} is not watertight: load it with load_object, which repairs it")
    centre = np.array(mesh.center_mass)
    centred = mesh.copy()
    centred.apply_translation(-centre)
    inertia = np.array(centred.moment_inertia) * (mass / centred.volume)
    moved = tuple(part.translated(-centre) for part in parts)
    return ObjectModel(name, Solid.of(centred), moved, mass, 0.5 * (inertia + inertia.T), **more)


def reduced_hull(points: Array, limit: int) -> trimesh.Trimesh:
    """Return a convex hull of `points` (n, 3) with at most `limit` vertices.

    A hull with more is replaced by one inside it: the furthest points along a few even directions, then
    again and again the point that stands out most.
    """
    from trimesh.convex import convex_hull

    hull = convex_hull(points)
    corners = np.asarray(hull.vertices)
    if len(corners) <= limit:
        return hull
    kept = list(np.unique((corners @ fibonacci_directions(limit // 4).T).argmax(0)))
    while len(kept) < limit:
        planes = planes_of(corners[kept])
        kept.append((corners @ planes[:, :3].T + planes[:, 3]).max(axis=1).argmax())
    return convex_hull(corners[kept])


def _microns(values: Array) -> np.ndarray:
    """Whole millionths, so that the last bits of a sine on another machine change no hash."""
    return np.rint(np.asarray(values, dtype=float) * 1e6).astype(np.int64)
