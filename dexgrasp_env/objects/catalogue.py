"""The catalogue, from assets/objects/catalogue.yaml: six training objects and the twenty objects of Tables 1-3."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml

from dexgrasp_env.arrays import Array
from dexgrasp_env.assets import asset_path
from dexgrasp_env.objects import bottles, shapes
from dexgrasp_env.objects.model import ObjectModel, centred_model
from dexgrasp_env.objects.parts import ContactPart
from dexgrasp_env.objects.solid import Solid


@dataclass(frozen=True)
class ObjectSpec:
    """One entry of the catalogue.

    Attributes:
        name: what it is called everywhere.
        shape: one line for people.
        builder: function that makes the shape.
        params: its arguments, metres.
        mass: kilograms.
        rgba: colour.
        approximate: whether size and mass are our guess at the paper's object.
        fixed_pose: wxyz of the one pose it is presented in, or None for its rest poses.
    """

    name: str
    shape: str
    builder: Callable[..., shapes.Shape]
    params: Mapping[str, Any]
    mass: float
    rgba: tuple[float, float, float, float]
    approximate: bool = True
    fixed_pose: tuple[float, float, float, float] | None = None

    def build(self) -> ObjectModel:
        """Make the object; `stored_object` reads what was made before."""
        shape = self.builder(**self.params)
        made = centred_model(self.name, shape.mesh, shape.parts, self.mass)
        return self.model(made.solid, made.parts, made.inertia)

    def model(self, solid: Solid, parts: tuple[ContactPart, ...], inertia: Array) -> ObjectModel:
        """Return the object with a shape that was made; the arguments are attributes of `ObjectModel`."""
        notes = (
            ("size and mass approximate the everyday object: the paper published none",)
            if self.approximate
            else ()
        )
        fixed_pose = None if self.fixed_pose is None else np.array(self.fixed_pose)
        return ObjectModel(
            self.name, solid, parts, self.mass, inertia, fixed_pose=fixed_pose, rgba=self.rgba, notes=notes
        )


def _specs(content: Mapping[str, Mapping[str, Any]]) -> dict[str, ObjectSpec]:
    specs = {}
    for name, entry in content.items():
        builder = getattr(shapes, entry["builder"], None) or getattr(bottles, entry["builder"])
        pose = tuple(entry["fixed_pose"]) if "fixed_pose" in entry else None
        specs[name] = ObjectSpec(
            name, entry["shape"], builder, entry["params"], entry["mass"], (*entry["rgb"], 1.0),
            entry.get("approximate", True), pose,
        )  # fmt: skip
    return specs


_CONTENT = yaml.load(
    asset_path("objects", "catalogue.yaml").read_bytes(), Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)
)

CATALOGUE: dict[str, ObjectSpec] = _specs(_CONTENT["objects"])
"""Every object by name."""

OBJECT_SETS: dict[str, tuple[str, ...]] = {name: tuple(members) for name, members in _CONTENT["sets"].items()}
"""The sets: training, and those of Tables 1-3 in the tables' order."""
OBJECT_SETS["all20"] = OBJECT_SETS["seen"] + OBJECT_SETS["familiar"] + OBJECT_SETS["novel"]
