"""Identity of the object of a grasp: its name, where its surface comes from, and a hash of that surface."""

from dataclasses import dataclass

import numpy as np

from dexgrasp.grasp.field_types import Positive, Vector, Word
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import content_hash
from dexgrasp_env.objects.load import has_own_size, load_object
from dexgrasp_env.objects.model import ObjectModel


@dataclass(frozen=True, eq=False)
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

    name: Word
    source: Word | None = None
    scale: Positive = 1.0
    content_hash: Word | None = None
    known_mass: Positive | None = None
    known_centre: Vector | None = None

    @classmethod
    def of(cls, model: ObjectModel, source: str, scale: float = 1.0) -> "ObjectIdentity":
        """Identify an object that was loaded from `source`, a bare mesh file at `scale`."""
        return cls(model.name, source, 1.0 if has_own_size(source) else scale, surface_hash(model))

    def load(self) -> ObjectModel | None:
        """Return the object, or None where there is no source.

        Raises:
            InputError: if the source is not here.
        """
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


def surface_hash(model: ObjectModel) -> str:
    """Return a hash of an object's surface: vertices to a micron, and faces."""
    return content_hash(np.rint(model.solid.vertices * 1e6).astype(np.int64), model.solid.faces)
