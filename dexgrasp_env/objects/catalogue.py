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
"""How many there are."""
_NAME = re.compile(r"(varied|drawn)-(\d{1,6})(?:\.\.(\d{1,6}))?")
_DENSITY = (150.0, 700.0)  # kg/m^3: from a filled cardboard box to a bottle that is not quite full
_MASS = (0.04, 0.6)  # kg
_RGBA = (0.55, 0.6, 0.7, 1.0)


def varied_targets(target: str) -> tuple[str, ...]:
    """Return the names that `varied-N` or `varied-FIRST..LAST` stands for, or `drawn-`; none for other targets.

    Raises:
        InputError: for numbers that there are no objects of.
    """
    match = _NAME.fullmatch(target)
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
    family, _, number = target.partition("-")
    word, kinds = _FAMILIES[family]
    rng = np.random.default_rng([int(number), word])
    shares = np.array([weight for weight, *_ in kinds])
    _, builder, drawn = kinds[int(rng.choice(len(kinds), p=shares / shares.sum()))]
    shape = builder(**drawn(rng))
    mass = float(np.clip(shape.mesh.volume * rng.uniform(*_DENSITY), *_MASS))
    return centred_model(
        target, shape.mesh, shape.parts, mass, rgba=_RGBA, notes=(f"{builder.__name__} of random size",)
    )


_Kinds = tuple[tuple[float, Callable[..., shapes.Shape], Callable[[Generator], Fields]], ...]
_VARIED: _Kinds = (
    (4.0, shapes.box, lambda rng: {"size": rng.uniform((0.025, 0.045, 0.05), (0.085, 0.16, 0.21))}),
    (2.0, shapes.rounded_box, lambda rng: {
        "size": (size := rng.uniform((0.035, 0.05, 0.05), (0.08, 0.13, 0.16))),
        "corner": 0.3 * size[0] * rng.uniform(0.4, 1.0), "edge": 0.003,
    }),
    (3.0, shapes.cylinder, lambda rng: {"diameter": rng.uniform(0.04, 0.085), "height": rng.uniform(0.06, 0.24)}),
    (1.0, bottles.tapered_can, lambda rng: {
        "diameter": (d := rng.uniform(0.05, 0.085)), "height": rng.uniform(0.09, 0.18),
        "foot": 0.76 * d, "rim": 0.82 * d,
    }),
    (1.0, bottles.cup, lambda rng: {
        "top": (top := rng.uniform(0.07, 0.1)), "foot": top * rng.uniform(0.6, 0.85), "height": rng.uniform(0.07, 0.13),
    }),
    (1.0, bottles.pill_bottle, lambda rng: {
        "diameter": (d := rng.uniform(0.04, 0.075)), "height": (height := rng.uniform(0.07, 0.13)),
        "cap_diameter": d * rng.uniform(0.8, 1.08), "cap_height": 0.2 * height,
    }),
    (1.0, bottles.cone_tower, lambda rng: {
        "diameter": (d := rng.uniform(0.05, 0.08)), "wall": rng.uniform(0.06, 0.11),
        "roof_diameter": d * rng.uniform(1.0, 1.25), "roof": rng.uniform(0.03, 0.08),
    }),
    (1.0, bottles.domed_bottle, lambda rng: {
        "diameter": rng.uniform(0.042, 0.075), "height": rng.uniform(0.13, 0.24),
    }),
    (1.0, bottles.squeeze_bottle, lambda rng: {
        "diameter": rng.uniform(0.048, 0.08), "height": rng.uniform(0.14, 0.21),
    }),
    (2.0, bottles.oval_bottle, lambda rng: {
        "size": rng.uniform((0.04, 0.06, 0.13), (0.07, 0.1, 0.2)),
        "top": (((neck := 0.011 * rng.uniform(0.9, 1.6)), 0.82), (1.2 * neck, 0.82), (1.2 * neck, 1.0)),
        "square": rng.uniform(2.2, 3.2), "body": rng.uniform(0.55, 0.68), "shoulder": 0.79,
    }),
    (1.0, bottles.pear, lambda rng: {
        "diameter": (d := rng.uniform(0.055, 0.085)), "height": d * rng.uniform(1.2, 1.6),
    }),
    (1.0, bottles.clamshell, lambda rng: {"size": rng.uniform((0.11, 0.055, 0.045), (0.18, 0.085, 0.07))}),
    (2.0, shapes.prism, lambda rng: {
        "polygon": ((0.0, 0.0), (rng.uniform(0.08, 0.14), 0.0), (0.0, rng.uniform(0.08, 0.14))),
        "thickness": rng.uniform(0.05, 0.085),
    }),
    (1.0, shapes.tetrahedron, lambda rng: {"edge": rng.uniform(0.08, 0.12)}),
    (1.0, shapes.spiked_ball, lambda rng: {
        "diameter": rng.uniform(0.055, 0.085), "spike": rng.uniform(0.004, 0.009), "radius": 0.004,
    }),
    (1.0, shapes.brick_tower, lambda rng: {
        "side": rng.uniform(0.03, 0.045), "bricks": (bricks := int(rng.integers(3, 8))),
        "height": bricks * rng.uniform(0.018, 0.02) + 0.0046, "stud": 0.0046,
    }),
)  # fmt: skip
"""Weight, builder, and what draws its arguments, in metres, in the order in which they stand."""


def _stone(rng: Generator) -> Fields:
    """Draw the corners of a stone: points of an ellipsoid."""
    directions = rng.standard_normal((int(rng.integers(8, 15)), 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return {"vertices": directions * rng.uniform((0.025,) * 3, (0.06,) * 3)}


def _cone(rng: Generator) -> Fields:
    """Draw the profile of a cone without its tip, point up or down."""
    wide, height = rng.uniform(0.025, 0.06), rng.uniform(0.05, 0.12)
    narrow = wide * rng.uniform(0.2, 0.7)
    return {
        "profile": [(wide, 0.0), (narrow, height)] if rng.random() < 0.5 else [(narrow, 0.0), (wide, height)]
    }


_DRAWN: _Kinds = (
    (1.0, shapes.box, lambda rng: {"size": rng.uniform((0.03,) * 3, (0.12,) * 3)}),
    (1.0, shapes.cylinder, lambda rng: {"diameter": rng.uniform(0.03, 0.12), "height": rng.uniform(0.03, 0.12)}),
    (4.0, shapes.polyhedron, _stone),
    (2.0, shapes.prism, lambda rng: {
        "polygon": ((0.0, 0.0), (rng.uniform(0.06, 0.12), 0.0), (rng.uniform(0.0, 0.06), rng.uniform(0.06, 0.12))),
        "thickness": rng.uniform(0.05, 0.12),
    }),
    (2.0, shapes.tetrahedron, lambda rng: {"edge": rng.uniform(0.07, 0.12)}),
    (2.0, shapes.revolve, _cone),
)  # fmt: skip
_FAMILIES = {"varied": (20221, _VARIED), "drawn": (20302, _DRAWN)}
"""Word that the draws begin from, and kinds."""
