"""The catalogue, from assets/objects/catalogue.yaml: six training objects and the twenty objects of Tables 1-3.

And objects of random sizes by the same builders, so that whoever learns on them has not met the catalogue's own:
`varied-17` is always the same one, `varied-0..199` names two hundred. Those of `drawn-N` have all sides between 3 and
12 cm, and more shapes.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.random import Generator

from dexgrasp_env.arrays import Arrays, Fields, divided, joined
from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import cached_arrays, content_hash
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
    def look(self) -> Fields:
        """The attributes of its `ObjectModel` that do not follow from shape and mass."""
        guess = "size and mass approximate the everyday object: the paper published none"
        return {
            "rgba": (*self.rgb, 1.0),
            "notes": (guess,) if self.approximate else (),
            "fixed_pose": None if self.fixed_pose is None else np.array(self.fixed_pose),
        }

    def build(self) -> ObjectModel:
        """Make the object; `catalogue_object` reads what was made before."""
        shape = _builder(self.builder)(**self.params)
        return centred_model(self.name, shape.mesh, shape.parts, self.mass, **self.look)


def _builder(name: str) -> Callable[..., shapes.Shape]:
    return getattr(shapes, name, None) or getattr(bottles, name)


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


@lru_cache(maxsize=64)
def catalogue_object(name: str) -> ObjectModel:
    """Return an object of the catalogue as its `ObjectSpec.build` makes it, made once."""
    spec = CATALOGUE[name]
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


MOST = 100_000
"""Objects of a family of random sizes."""


def varied_targets(target: str) -> tuple[str, ...]:
    """Return the names that `varied-N` or `varied-FIRST..LAST` stands for, or `drawn-`; none for other targets.

    Raises:
        InputError: for numbers that there are no objects of.
    """
    match = re.fullmatch(r"(varied|drawn)-(\d{1,6})(?:\.\.(\d{1,6}))?", target)
    if match is None:
        return ()
    family, first, last = match[1], int(match[2]), int(match[3] or match[2])
    if not first <= last < MOST:
        raise InputError(
            f"objects {target!r}: valid are {family}-0 to {family}-{MOST - 1}, or {family}-FIRST..LAST"
        )
    return tuple(f"{family}-{number}" for number in range(first, last + 1))


@lru_cache(maxsize=64)
def varied_object(target: str) -> ObjectModel:
    """Return the object that `varied-N` or `drawn-N` names: its kind, sizes and mass are drawn by its number."""
    name, _, number = target.partition("-")
    family = _CONTENT["families"][name]
    rng = np.random.default_rng([int(number), family["word"]])
    weights = np.array([float(kind["weight"]) for kind in family["kinds"]])
    kind = family["kinds"][int(rng.choice(len(weights), p=weights / weights.sum()))]
    shape = _builder(kind["builder"])(**_params(rng, kind["draws"]))
    # kg/m^3: from a filled cardboard box to a bottle that is not quite full
    density = rng.uniform(150.0, 700.0)
    mass = float(np.clip(shape.mesh.volume * density, 0.04, 0.6))
    notes = (f"{kind['builder']} of random size",)
    return centred_model(target, shape.mesh, shape.parts, mass, rgba=(0.55, 0.6, 0.7, 1.0), notes=notes)


def _params(rng: Generator, draws: Fields | str) -> Fields:
    """Return the arguments of a builder that its entry in the catalogue's families has drawn."""
    if isinstance(draws, str):
        return _DRAWS[draws](rng)
    params = Fields()
    for name, value in draws.items():
        params[name] = _drawn(rng, value, params)
    return params


def _drawn(rng: Generator, value: Any, before: Fields) -> Any:
    if isinstance(value, list):
        return [_drawn(rng, each, before) for each in value]
    if not isinstance(value, dict):
        return value
    drawn = value["share"] if "share" in value else rng.uniform(value["low"], value["high"])
    return before[value["of"]] * drawn if "of" in value else drawn


def _rounded_box(rng: Generator) -> Fields:
    size = rng.uniform((0.035, 0.05, 0.05), (0.08, 0.13, 0.16))
    return {"size": size, "corner": 0.3 * size[0] * rng.uniform(0.4, 1.0), "edge": 0.003}


def _oval_bottle(rng: Generator) -> Fields:
    size, neck = rng.uniform((0.04, 0.06, 0.13), (0.07, 0.1, 0.2)), 0.011 * rng.uniform(0.9, 1.6)
    return {
        "size": size, "top": ((neck, 0.82), (1.2 * neck, 0.82), (1.2 * neck, 1.0)),
        "square": rng.uniform(2.2, 3.2), "body": rng.uniform(0.55, 0.68), "shoulder": 0.79,
    }  # fmt: skip


def _brick_tower(rng: Generator) -> Fields:
    side, bricks, stud = rng.uniform(0.03, 0.045), int(rng.integers(3, 8)), 0.0046
    return {"side": side, "bricks": bricks, "height": bricks * rng.uniform(0.018, 0.02) + stud, "stud": stud}


def _stone(rng: Generator) -> Fields:
    """Draw the corners of a stone: points of an ellipsoid."""
    directions = rng.standard_normal((int(rng.integers(8, 15)), 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return {"vertices": directions * rng.uniform((0.025,) * 3, (0.06,) * 3)}


def _cone(rng: Generator) -> Fields:
    """Draw the profile of a cone without its tip, point up or down."""
    wide, height = rng.uniform(0.025, 0.06), rng.uniform(0.05, 0.12)
    narrow = wide * rng.uniform(0.2, 0.7)
    low, high = (wide, narrow) if rng.random() < 0.5 else (narrow, wide)
    return {"profile": [(low, 0.0), (high, height)]}


_DRAWS = {
    "rounded_box": _rounded_box, "oval_bottle": _oval_bottle, "brick_tower": _brick_tower, "stone": _stone,
    "cone": _cone,
}  # fmt: skip
