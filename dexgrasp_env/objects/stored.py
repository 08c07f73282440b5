"""Objects of the catalogue as they are kept in the cache: read in a moment, without trimesh."""

from __future__ import annotations

from dataclasses import fields
from functools import cache
from pathlib import Path

import numpy as np

from dexgrasp_env.arrays import divided, joined
from dexgrasp_env.files import Arrays, cached_arrays, content_hash
from dexgrasp_env.objects import bottles, loft, model, parts, shapes
from dexgrasp_env.objects.catalogue import ObjectSpec
from dexgrasp_env.objects.model import ObjectModel, Solid
from dexgrasp_env.objects.parts import ContactPart

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
