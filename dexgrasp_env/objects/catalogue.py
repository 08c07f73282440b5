"""The catalogue: six training objects and the twenty objects of Tables 1-3, as data.

Sizes of YCB objects are aligned scan extents, rounded, and their masses the published ones. The paper
published neither sizes nor masses of its own test objects: entries marked `approximate` are everyday objects
of that kind. Mass is spread evenly over the volume of the mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.objects import bottles, shapes
from dexgrasp_env.objects.model import ObjectModel, centred_model
from dexgrasp_env.objects.parts import ContactPart
from dexgrasp_env.objects.solid import Solid

_SQUARE_ROOT_HALF = float(np.sqrt(0.5))


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


def _box(
    name: str, size: tuple[float, float, float], mass: float, rgb: tuple[float, float, float], **rest: Any
) -> ObjectSpec:
    return ObjectSpec(name, "box", shapes.box, {"size": size}, mass, (*rgb, 1.0), **rest)


_WEDGE = {"polygon": ((0.0, 0.0), (0.12, 0.0), (0.0, 0.12)), "thickness": 0.07}
_WEDGE_RGBA = (0.93, 0.78, 0.5, 1.0)

_SPECS = (
    _box("cracker_box", (0.060, 0.160, 0.210), 0.411, (0.75, 0.12, 0.1), approximate=False),
    _box("sugar_box", (0.041, 0.090, 0.175), 0.514, (0.95, 0.8, 0.15), approximate=False),
    ObjectSpec("tomato_soup_can", "cylinder", shapes.cylinder, {"diameter": 0.066, "height": 0.101}, 0.349,
               (0.8, 0.15, 0.12, 1.0), approximate=False),
    ObjectSpec("mustard_bottle", "oval bottle with shoulders and nozzle", bottles.oval_bottle,
               {"size": (0.058, 0.096, 0.191), "square": 2.6, "body": 0.60, "shoulder": 0.80,
                "top": ((0.0165, 0.82), (0.019, 0.82), (0.019, 0.90), (0.009, 0.915), (0.004, 1.0))}, 0.603,
               (0.95, 0.75, 0.1, 1.0), approximate=False),
    _box("gelatin_box", (0.030, 0.089, 0.073), 0.097, (0.7, 0.2, 0.25), approximate=False),
    ObjectSpec("potted_meat_can", "rounded box", shapes.rounded_box,
               {"size": (0.057, 0.101, 0.083), "corner": 0.016, "edge": 0.003}, 0.370, (0.15, 0.3, 0.65, 1.0),
               approximate=False),
    _box("webcam", (0.120, 0.080, 0.060), 0.250, (0.2, 0.25, 0.35)),
    _box("mask", (0.190, 0.100, 0.080), 0.200, (0.45, 0.7, 0.85)),
    ObjectSpec("chips", "tall cylinder", shapes.cylinder, {"diameter": 0.075, "height": 0.230}, 0.205,
               (0.85, 0.15, 0.15, 1.0)),
    ObjectSpec("soda", "cylinder with tapered ends", bottles.tapered_can,
               {"diameter": 0.066, "height": 0.122, "foot": 0.050, "rim": 0.054}, 0.370,
               (0.75, 0.1, 0.15, 1.0)),
    ObjectSpec("glasses_case", "rounded clamshell", bottles.clamshell, {"size": (0.160, 0.065, 0.055)}, 0.120,
               (0.25, 0.2, 0.2, 1.0)),
    ObjectSpec("ramen", "cup, wide on top", bottles.cup, {"top": 0.096, "foot": 0.068, "height": 0.107},
               0.085, (0.9, 0.45, 0.15, 1.0)),
    ObjectSpec("pill_bottle", "cylinder with a wider cap", bottles.pill_bottle,
               {"diameter": 0.050, "height": 0.090, "cap_diameter": 0.052, "cap_height": 0.018}, 0.080,
               (0.9, 0.5, 0.2, 1.0)),
    ObjectSpec("sandwich_upright", "triangular prism on a leg", shapes.prism, _WEDGE, 0.180, _WEDGE_RGBA,
               fixed_pose=(1.0, 0.0, 0.0, 0.0)),
    ObjectSpec("sandwich_side", "triangular prism on its side", shapes.prism, _WEDGE, 0.180, _WEDGE_RGBA,
               fixed_pose=(_SQUARE_ROOT_HALF, _SQUARE_ROOT_HALF, 0.0, 0.0)),
    ObjectSpec("massage_ball", "ball with rigid spikes", shapes.spiked_ball,
               {"diameter": 0.075, "spike": 0.007, "radius": 0.004, "count": 32}, 0.120,
               (0.45, 0.3, 0.7, 1.0)),
    ObjectSpec("castle", "tower with a cone roof", bottles.cone_tower,
               {"diameter": 0.070, "wall": 0.080, "roof_diameter": 0.084, "roof": 0.060}, 0.150,
               (0.6, 0.6, 0.65, 1.0)),
    ObjectSpec("tetrahedron", "regular tetrahedron", shapes.tetrahedron, {"edge": 0.100}, 0.090,
               (0.2, 0.65, 0.4, 1.0)),
    ObjectSpec("hairspray_bottle", "slender bottle with a domed cap", bottles.domed_bottle,
               {"diameter": 0.052, "height": 0.225}, 0.300, (0.7, 0.7, 0.75, 1.0)),
    ObjectSpec("pear", "body of revolution", bottles.pear, {"diameter": 0.070, "height": 0.100}, 0.150,
               (0.7, 0.75, 0.2, 1.0)),
    ObjectSpec("alcohol_bottle", "oval bottle with a neck", bottles.oval_bottle,
               {"size": (0.070, 0.045, 0.180), "square": 2.8, "body": 0.66, "shoulder": 0.78,
                "top": ((0.011, 0.82), (0.0135, 0.82), (0.0135, 1.0))}, 0.330, (0.6, 0.8, 0.9, 1.0)),
    ObjectSpec("condiment_bottle", "squeeze bottle with a conical nozzle", bottles.squeeze_bottle,
               {"diameter": 0.062, "height": 0.195}, 0.350, (0.85, 0.2, 0.1, 1.0)),
    ObjectSpec("lego", "slender tower of bricks", shapes.brick_tower,
               {"side": 0.032, "height": 0.115, "bricks": 6, "stud": 0.0046}, 0.070, (0.1, 0.4, 0.8, 1.0)),
)  # fmt: skip

_YCB6 = ("cracker_box", "sugar_box", "tomato_soup_can", "mustard_bottle", "gelatin_box", "potted_meat_can")
_SEEN = ("sugar_box", "tomato_soup_can", "mustard_bottle")
_FAMILIAR = ("webcam", "mask", "chips", "soda")
_NOVEL = (
    "glasses_case", "ramen", "pill_bottle", "sandwich_upright", "sandwich_side", "massage_ball", "castle",
    "tetrahedron", "hairspray_bottle", "pear", "alcohol_bottle", "condiment_bottle", "lego",
)  # fmt: skip

CATALOGUE: dict[str, ObjectSpec] = {spec.name: spec for spec in _SPECS}
"""Every object by name."""

OBJECT_SETS: dict[str, tuple[str, ...]] = {
    "ycb6": _YCB6,
    "seen": _SEEN,
    "familiar": _FAMILIAR,
    "novel": _NOVEL,
    "all20": (*_SEEN, *_FAMILIAR, *_NOVEL),
}
"""The sets: training, and those of Tables 1-3 in the tables' order."""
