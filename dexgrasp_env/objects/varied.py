"""Objects of random sizes: `varied-17` is always the same one, `varied-0..199` names two hundred.

They are made by the catalogue's builders, so that whoever learns on them has not met the catalogue's own objects.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.random import Generator

from dexgrasp_env.errors import InputError
from dexgrasp_env.objects import bottles, shapes
from dexgrasp_env.objects.model import ObjectModel, centred_model

MOST = 100_000
"""How many there are."""
_NAME = re.compile(r"varied-(\d{1,6})(?:\.\.(\d{1,6}))?")
_DENSITY = (150.0, 700.0)  # kg/m^3: from a filled cardboard box to a bottle that is not quite full
_MASS = (0.04, 0.6)  # kg
_RGBA = (0.55, 0.6, 0.7, 1.0)

_Drawn = tuple[Callable[..., shapes.Shape], dict[str, Any]]


def varied_targets(target: str) -> tuple[str, ...]:
    """Return the names that `varied-N` or `varied-FIRST..LAST` stands for; none for other targets.

    Raises:
        InputError: for numbers that there are no objects of.
    """
    match = _NAME.fullmatch(target)
    if match is None:
        return ()
    first, last = int(match[1]), int(match[2] or match[1])
    if not first <= last < MOST:
        raise InputError(
            f"objects {target!r}: valid are varied-0 to varied-{MOST - 1}, or varied-FIRST..LAST"
        )
    return tuple(f"varied-{number}" for number in range(first, last + 1))


@lru_cache(maxsize=64)
def varied_object(target: str) -> ObjectModel:
    """Return the object that `varied-N` names: its kind, sizes and mass are drawn by its number."""
    rng = np.random.default_rng([int(target.removeprefix("varied-")), 20221])
    builder, params = _KINDS[int(rng.choice(len(_KINDS), p=_SHARES))](rng)
    shape = builder(**params)
    mass = float(np.clip(shape.mesh.volume * rng.uniform(*_DENSITY), *_MASS))
    notes = (f"{builder.__name__} of random size",)
    return centred_model(target, shape.mesh, shape.parts, mass, rgba=_RGBA, notes=notes)


def _box(rng: Generator) -> _Drawn:
    sides = rng.uniform((0.025, 0.045, 0.05), (0.085, 0.16, 0.21))
    return shapes.box, {"size": sides}


def _rounded_box(rng: Generator) -> _Drawn:
    size = rng.uniform((0.035, 0.05, 0.05), (0.08, 0.13, 0.16))
    return shapes.rounded_box, {"size": size, "corner": 0.3 * size[0] * rng.uniform(0.4, 1.0), "edge": 0.003}


def _cylinder(rng: Generator) -> _Drawn:
    return shapes.cylinder, {"diameter": rng.uniform(0.04, 0.085), "height": rng.uniform(0.06, 0.24)}


def _can(rng: Generator) -> _Drawn:
    d = rng.uniform(0.05, 0.085)
    return bottles.tapered_can, {
        "diameter": d,
        "height": rng.uniform(0.09, 0.18),
        "foot": 0.76 * d,
        "rim": 0.82 * d,
    }


def _cup(rng: Generator) -> _Drawn:
    top = rng.uniform(0.07, 0.1)
    return bottles.cup, {"top": top, "foot": top * rng.uniform(0.6, 0.85), "height": rng.uniform(0.07, 0.13)}


def _pill_bottle(rng: Generator) -> _Drawn:
    d, height = rng.uniform(0.04, 0.075), rng.uniform(0.07, 0.13)
    return bottles.pill_bottle, {
        "diameter": d, "height": height, "cap_diameter": d * rng.uniform(0.8, 1.08), "cap_height": 0.2 * height,
    }  # fmt: skip


def _tower(rng: Generator) -> _Drawn:
    d = rng.uniform(0.05, 0.08)
    return bottles.cone_tower, {
        "diameter": d, "wall": rng.uniform(0.06, 0.11), "roof_diameter": d * rng.uniform(1.0, 1.25),
        "roof": rng.uniform(0.03, 0.08),
    }  # fmt: skip


def _spray(rng: Generator) -> _Drawn:
    return bottles.domed_bottle, {"diameter": rng.uniform(0.042, 0.075), "height": rng.uniform(0.13, 0.24)}


def _squeeze_bottle(rng: Generator) -> _Drawn:
    return bottles.squeeze_bottle, {"diameter": rng.uniform(0.048, 0.08), "height": rng.uniform(0.14, 0.21)}


def _oval_bottle(rng: Generator) -> _Drawn:
    size = rng.uniform((0.04, 0.06, 0.13), (0.07, 0.1, 0.2))
    neck = 0.011 * rng.uniform(0.9, 1.6)
    return bottles.oval_bottle, {
        "size": size, "square": rng.uniform(2.2, 3.2), "body": rng.uniform(0.55, 0.68), "shoulder": 0.79,
        "top": ((neck, 0.82), (1.2 * neck, 0.82), (1.2 * neck, 1.0)),
    }  # fmt: skip


def _pear(rng: Generator) -> _Drawn:
    d = rng.uniform(0.055, 0.085)
    return bottles.pear, {"diameter": d, "height": d * rng.uniform(1.2, 1.6)}


def _clamshell(rng: Generator) -> _Drawn:
    return bottles.clamshell, {"size": rng.uniform((0.11, 0.055, 0.045), (0.18, 0.085, 0.07))}


def _wedge(rng: Generator) -> _Drawn:
    a, b = rng.uniform(0.08, 0.14, 2)
    return shapes.prism, {"polygon": ((0.0, 0.0), (a, 0.0), (0.0, b)), "thickness": rng.uniform(0.05, 0.085)}


def _tetrahedron(rng: Generator) -> _Drawn:
    return shapes.tetrahedron, {"edge": rng.uniform(0.08, 0.12)}


def _spiked_ball(rng: Generator) -> _Drawn:
    return shapes.spiked_ball, {
        "diameter": rng.uniform(0.055, 0.085), "spike": rng.uniform(0.004, 0.009), "radius": 0.004, "count": 32,
    }  # fmt: skip


def _brick_tower(rng: Generator) -> _Drawn:
    side, bricks = rng.uniform(0.03, 0.045), int(rng.integers(3, 8))
    return shapes.brick_tower, {
        "side": side, "height": bricks * rng.uniform(0.018, 0.02) + 0.0046, "bricks": bricks, "stud": 0.0046,
    }  # fmt: skip


_KINDS = (
    _box, _rounded_box, _cylinder, _can, _cup, _pill_bottle, _tower, _spray, _squeeze_bottle, _oval_bottle, _pear,
    _clamshell, _wedge, _tetrahedron, _spiked_ball, _brick_tower,
)  # fmt: skip
_WEIGHTS = np.array([4.0, 2.0, 3.0, *(1.0,) * 6, 2.0, 1.0, 1.0, 2.0, 1.0, 1.0, 1.0])
_SHARES = _WEIGHTS / _WEIGHTS.sum()
