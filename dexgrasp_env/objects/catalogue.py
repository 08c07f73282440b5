"""The catalogue, from assets/objects/catalogue.yaml: six training objects and the twenty objects of Tables 1-3."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml

from dexgrasp_env.assets import asset_path
from dexgrasp_env.objects import bottles, shapes
from dexgrasp_env.objects.model import ObjectModel, centred_model


@dataclass(frozen=True)
class ObjectSpec:
    """One entry of the catalogue.

    Attributes:
        name: what it is called everywhere.
        shape: one line for people.
        builder: name of the function of `shapes` or `bottles` that makes the shape.
        params: its arguments, metres.
        mass: kilograms.
        rgb: colour.
        approximate: whether size and mass are our guess at the paper's object.
        fixed_pose: wxyz of the one pose it is presented in, or None for its rest poses.
    """

    name: str
    shape: str
    builder: str
    params: Mapping[str, Any]
    mass: float
    rgb: Sequence[float]
    approximate: bool = True
    fixed_pose: Sequence[float] | None = None

    @property
    def look(self) -> dict[str, Any]:
        """The attributes of its `ObjectModel` that do not follow from shape and mass."""
        guess = "size and mass approximate the everyday object: the paper published none"
        return {
            "rgba": (*self.rgb, 1.0),
            "notes": (guess,) if self.approximate else (),
            "fixed_pose": None if self.fixed_pose is None else np.array(self.fixed_pose),
        }

    def build(self) -> ObjectModel:
        """Make the object; `stored_object` reads what was made before."""
        builder = getattr(shapes, self.builder, None) or getattr(bottles, self.builder)
        shape = builder(**self.params)
        return centred_model(self.name, shape.mesh, shape.parts, self.mass, **self.look)


_CONTENT = yaml.load(
    asset_path("objects", "catalogue.yaml").read_bytes(), Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)
)

CATALOGUE: dict[str, ObjectSpec] = {
    name: ObjectSpec(name, **entry) for name, entry in _CONTENT["objects"].items()
}
"""Every object by name."""

OBJECT_SETS: dict[str, tuple[str, ...]] = {name: tuple(members) for name, members in _CONTENT["sets"].items()}
"""The sets: training, and those of Tables 1-3 in the tables' order."""
OBJECT_SETS["all20"] = OBJECT_SETS["seen"] + OBJECT_SETS["familiar"] + OBJECT_SETS["novel"]
