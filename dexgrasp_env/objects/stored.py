"""Objects of the catalogue as they are kept in the cache: read in a moment, without trimesh."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np

from dexgrasp_env.files import Arrays, cached_arrays, content_hash
from dexgrasp_env.objects import bottles, loft, model, parts, shapes
from dexgrasp_env.objects.catalogue import ObjectSpec
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.objects.parts import KINDS, ContactPart
from dexgrasp_env.objects.solid import Solid

_LAYOUT = {
    "vertices": (None, 3), "faces": (None, 3), "corners": (None, 3), "hull_centre": (3,), "inertia": (3, 3),
    "kinds": (None,), "sizes": (None, 3), "positions": (None, 3), "quats_wxyz": (None, 4),
    "part_vertices": (None, 3), "part_counts": (None,),
}  # fmt: skip


def stored_object(spec: ObjectSpec) -> ObjectModel:
    """Return an object of the catalogue as `spec.build` makes it, made once."""
    key = content_hash(_sources(), spec.builder.__name__, dict(spec.params), spec.mass)
    arrays = cached_arrays(f"objects/{spec.name}_{key}.npy", _LAYOUT, lambda: _arrays(spec.build()))
    solid = Solid(*(arrays[name] for name in ("vertices", "faces", "corners", "hull_centre")))
    return spec.model(solid, _parts(arrays), arrays["inertia"])


@cache
def _sources() -> str:
    """Return a hash of the code that makes objects."""
    modules = bottles, loft, model, parts, shapes
    return content_hash(*(Path(str(module.__file__)).read_bytes() for module in modules))


def _arrays(built: ObjectModel) -> Arrays:
    solid, pieces = built.solid, built.parts
    return {
        "vertices": solid.vertices, "faces": solid.faces, "corners": solid.corners, "hull_centre": solid.hull_centre,
        "inertia": built.inertia, **_part_arrays(pieces),
    }  # fmt: skip


def _part_arrays(pieces: Sequence[ContactPart]) -> Arrays:
    return {
        "kinds": np.array([KINDS.index(part.kind) for part in pieces]),
        "sizes": np.array([part.size for part in pieces]),
        "positions": np.array([part.position for part in pieces]),
        "quats_wxyz": np.array([part.quat_wxyz for part in pieces]),
        "part_vertices": np.concatenate([part.vertices for part in pieces]),
        "part_counts": np.array([len(part.vertices) for part in pieces]),
    }


def _parts(arrays: Arrays) -> tuple[ContactPart, ...]:
    kinds = [KINDS[kind] for kind in arrays["kinds"].tolist()]
    vertices = np.split(arrays["part_vertices"], np.cumsum(arrays["part_counts"])[:-1])
    columns = arrays["sizes"], arrays["positions"], arrays["quats_wxyz"], vertices
    return tuple(map(ContactPart, kinds, *columns))
