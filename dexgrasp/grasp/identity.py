"""Which object a grasp is of: its name, where its surface comes from, and a hash of that surface."""

from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from dexgrasp.grasp.values import array, positive, word
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import content_hash
from dexgrasp_env.objects.model import ObjectModel


@dataclass(frozen=True)
class ObjectIdentity:
    """An object that can be found again, or the name alone of one that was only seen.

    Attributes:
        name: as it is shown.
        source: name of the catalogue or path of a mesh file; None where only a cloud was seen.
        scale: factor from the source's unit to metres (1 for what is no bare mesh file).
        content_hash: of the surface in its own frame, vertices to a micron; None without a source.
        known_mass: kg, where the planner was told; None where it assumed one from the hull's volume.
        known_centre: (3,) m, world frame, where the planner was told the centre of mass.
    """

    name: str
    source: str | None = None
    scale: float = 1.0
    content_hash: str | None = None
    known_mass: float | None = None
    known_centre: tuple[float, float, float] | None = None

    @classmethod
    def of(cls, model: ObjectModel, source: str, scale: float = 1.0) -> "ObjectIdentity":
        """Identify an object that was loaded from `source` at `scale`."""
        return cls(model.name, source, scale, surface_hash(model))

    def load(self) -> ObjectModel | None:
        """Return the object, or None where there is no source.

        Raises:
            InputError: if the source is not here.
        """
        from dexgrasp_env.objects.load import has_own_size, load_object

        if self.source is None:
            return None
        try:
            model = load_object(self.source, scale=self.scale)
        except InputError as error:
            raise InputError(f"the object of the grasp, {self.source!r}, cannot be had: {error}") from None
        if has_own_size(self.source) and self.scale != 1.0:
            raise InputError(
                f"object scale is {self.scale}: {self.source} has a size of its own, and scale 1"
            )
        return model

    def as_json(self, base: Array) -> dict[str, Any]:
        """Return the identity as JSON holds it, in the frame of a robot's base at (3,) m."""
        centre = None if self.known_centre is None else (np.array(self.known_centre) - base).tolist()
        return asdict(self) | {"known_centre": centre}

    @classmethod
    def of_json(cls, value: dict[str, Any], base: Array) -> "ObjectIdentity":
        """Return the identity that JSON holds.

        Raises:
            KeyError, TypeError, ValueError: with what is missing or malformed.
        """
        name, source, scale, surface, mass, centre = (value[f.name] for f in fields(cls))
        if (source is None) != (surface is None):
            raise ValueError("the object's source and content_hash go together: both, or none")
        return cls(
            word("object name", name),
            None if source is None else word("source", source),
            positive("object scale", scale),
            None if surface is None else word("content_hash", surface),
            None if mass is None else positive("known_mass", mass),
            None if centre is None else tuple((array("known_centre", centre, (3,)) + base).tolist()),
        )


def surface_hash(model: ObjectModel) -> str:
    """Return a hash of an object's surface: vertices to a micron, and faces."""
    vertices = np.rint(model.solid.vertices * 1e6).astype(np.int64)
    return content_hash(vertices, model.solid.faces)
