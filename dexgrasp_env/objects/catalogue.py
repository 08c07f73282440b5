"""The catalogue, from assets/objects/catalogue.yaml: six training objects and the twenty objects of Tables 1-3."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from dexgrasp_env.arrays import divided, joined
from dexgrasp_env.assets import asset_path
from dexgrasp_env.files import Arrays, cached_arrays, content_hash
from dexgrasp_env.objects import bottles, loft, model, parts, shapes
from dexgrasp_env.objects.model import ObjectModel, Solid, centred_model
from dexgrasp_env.objects.parts import ContactPart


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


_VERSION = 2
_SOLID = [field.name for field in fields(Solid)]
_PART = ["kind", "size", "position", "quat_wxyz"]


def stored_object(spec: ObjectSpec) -> ObjectModel:
    """Return an object of the catalogue as `spec.build` makes it, made once."""
    key = content_hash(_VERSION, _sources(), spec.builder, dict(spec.params), spec.mass)
    arrays = cached_arrays(f"objects/{spec.name}_{key}.npy", lambda: _arrays(spec.build()))
    solid = Solid(*(arrays[name] for name in _SOLID))
    vertices = divided(arrays["points"], arrays["counts"])
    pieces = tuple(map(ContactPart, *(arrays[name].tolist() for name in _PART), vertices))
    return ObjectModel(spec.name, solid, pieces, spec.mass, arrays["inertia"], **spec.look)


@cache
def _sources() -> str:
    """Return a hash of the code that makes objects."""
    modules = bottles, loft, model, parts, shapes
    return content_hash(*(Path(str(module.__file__)).read_bytes() for module in modules))


def _arrays(built: ObjectModel) -> Arrays:
    return {
        **{name: getattr(built.solid, name) for name in _SOLID},
        **{name: np.array([getattr(part, name) for part in built.parts]) for name in _PART},
        **joined([part.vertices for part in built.parts]),
        "inertia": built.inertia,
    }
