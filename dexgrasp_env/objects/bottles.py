"""Bottles, cups and fruit: solids by their cross-sections, standing on z = 0, lengths in metres.

Proportions are fractions of the overall sizes, so that one builder serves bottles of any size.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from dexgrasp_env.objects.loft import Section
from dexgrasp_env.objects.shapes import Shape, loft, revolve

_PEAR = (  # radius and height as fractions of the largest radius and of the height
    (0.34, 0.0), (0.66, 0.03), (0.9, 0.14), (1.0, 0.32), (0.95, 0.47), (0.80, 0.60),
    (0.66, 0.70), (0.57, 0.79), (0.52, 0.86), (0.44, 0.93), (0.28, 0.98), (0.0, 1.0),
)  # fmt: skip


def _arc(start: tuple[float, float], end: tuple[float, float], steps: int) -> Any:
    """Quarter of an ellipse from (radius, height) `start`, upright there, to `end`, level there."""
    t = np.linspace(0.0, np.pi / 2, steps)
    radius = end[0] + (start[0] - end[0]) * np.cos(t)
    height = start[1] + (end[1] - start[1]) * np.sin(t)
    return np.column_stack([radius, height]).tolist()


def tapered_can(diameter: float, height: float, foot: float, rim: float) -> Shape:
    """A drink can: a cylinder that narrows to diameters `foot` below and `rim` on top."""
    r, top = diameter / 2, rim / 2
    return revolve(
        [(foot / 2, 0.0), (r, 0.08 * height), (r, 0.89 * height), (top, 0.97 * height), (top, height)]
    )


def cup(top: float, foot: float, height: float) -> Shape:
    """A closed cup: a truncated cone from diameter `foot` up to a rim of diameter `top`."""
    wall = 0.96 * top / 2
    return revolve([(foot / 2, 0.0), (wall, 0.955 * height), (top / 2, 0.955 * height), (top / 2, height)])


def pill_bottle(diameter: float, height: float, cap_diameter: float, cap_height: float) -> Shape:
    """A cylinder with a cylinder for a cap."""
    r, cap, z = diameter / 2, cap_diameter / 2, height - cap_height
    return revolve([(r, 0.0), (r, z), (cap, z), (cap, height)])


def cone_tower(diameter: float, wall: float, roof_diameter: float, roof: float) -> Shape:
    """A round tower of height `wall` under a cone of height `roof`."""
    r = diameter / 2
    return revolve([(r, 0.0), (r, wall), (roof_diameter / 2, wall), (0.0, wall + roof)])


def domed_bottle(diameter: float, height: float) -> Shape:
    """A slender spray bottle: a long cylinder, a small shoulder, a cap with a domed end."""
    r, cap = diameter / 2, 0.88 * diameter / 2
    return revolve(
        [(r, 0.0), (r, 0.72 * height), (cap, 0.75 * height), *_arc((cap, 0.905 * height), (0.0, height), 7)]
    )


def squeeze_bottle(diameter: float, height: float) -> Shape:
    """A squeeze bottle: a cylinder, a round shoulder, a flat cap and a long conical nozzle."""
    r = diameter / 2
    shoulder = _arc((r, 0.58 * height), (0.6 * r, 0.68 * height), 4)
    top = [(0.7 * r, 0.68 * height), (0.7 * r, 0.74 * height), (0.36 * r, 0.75 * height), (0.09 * r, height)]
    return revolve([(0.93 * r, 0.0), (r, 0.02 * height), *shoulder, *top])


def pear(diameter: float, height: float) -> Shape:
    """A pear that stands on a small flat, without its stem."""
    from scipy.interpolate import PchipInterpolator

    knots = np.array(_PEAR) * [diameter / 2, height]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(knots, axis=0).T))])
    fine = np.union1d(np.linspace(0.0, along[-1], 25), along)
    return revolve(PchipInterpolator(along, knots)(fine).tolist())


def oval_bottle(
    size: Sequence[float], *, square: float, body: float, shoulder: float, top: Sequence[tuple[float, float]]
) -> Shape:
    """An oval bottle whose shoulders draw in to a round neck.

    Args:
        size: (3,) overall sides, metres.
        square: exponent of the superellipse of the body, 2 oval to 4 nearly rectangular.
        body: height where the shoulders begin, as a fraction of the whole.
        shoulder: height where they end.
        top: (radius in metres, height as a fraction) of neck, cap and nozzle, upwards; the first is the neck.
    """
    a, b, height = size[0] / 2, size[1] / 2, size[2]
    neck = top[0][0]
    sections = [Section(0.0, 0.93 * a, 0.95 * b, square), Section(0.025 * height, a, b, square)]
    for t in np.linspace(0.0, np.pi / 2, 6):
        mix, z = np.cos(t), height * (body + (shoulder - body) * np.sin(t))
        sections.append(
            Section(z, neck + (a - neck) * mix, neck + (b - neck) * mix, 2.0 + (square - 2.0) * mix)
        )
    return loft([*sections, *(Section(z * height, r, r) for r, z in top)])


def clamshell(size: Sequence[float]) -> Shape:
    """A rounded case of two shells with a shallow groove where they meet.

    The groove is in the surface only.
    """
    a, b, c, groove = size[0] / 2, size[1] / 2, size[2] / 2, 8e-4
    sections = []
    for t in np.linspace(-1.0, 1.0, 15):
        level = np.sign(t) * np.sin(abs(t) * np.pi / 2)
        shrink = max(1.0 - abs(level) ** 2.6, 0.0) ** (1 / 2.6)
        inset = c * 0.9 * (1.0 - shrink)
        sections.append(Section(c * (1.0 + level), a - inset, b - inset, 3.0))
    lip = [Section(c + dz, a - cut, b - cut, 3.0) for dz, cut in ((-groove, 0), (0, groove), (groove, 0))]
    middle = len(sections) // 2
    return loft([*sections[:middle], *lip, *sections[middle + 1 :]])
