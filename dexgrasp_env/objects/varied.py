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
    _, builder, drawn = _KINDS[int(rng.choice(len(_KINDS), p=_SHARES))]
    shape = builder(**drawn(rng))
    mass = float(np.clip(shape.mesh.volume * rng.uniform(*_DENSITY), *_MASS))
    notes = (f"{builder.__name__} of random size",)
    return centred_model(target, shape.mesh, shape.parts, mass, rgba=_RGBA, notes=notes)


_KINDS: tuple[tuple[float, Callable[..., shapes.Shape], Callable[[Generator], dict[str, Any]]], ...] = (
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
_SHARES = np.array([weight for weight, *_ in _KINDS])
_SHARES /= _SHARES.sum()
