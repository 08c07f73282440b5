"""Write `flat.json`, `handled.json` and `wide.json`: what lies low, what has a handle, bowls, pots and trays.

    python scripts/kitchen.py sets/kitchen
    dexgrasp evaluate --agents hardcoded bilevel --objects sets/kitchen/flat.json --trials 5

Names, sizes and masses are frozen: `DIGESTS` are hashes of the meshes and masses of each set, and what differs is said.
"""

import hashlib
import math
import sys
from functools import reduce
from operator import add
from pathlib import Path
from typing import Any

import yaml
from manifold3d import CrossSection, Manifold
from outside import solid_obj
from set_files import write_set

from dexgrasp.cli.command import Argument, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp_env.files import write_atomically

DIGESTS = {"flat": "b9a4e040b5ee3652", "handled": "e44163e26b837fa2", "wide": "2df87f31181d5245"}
_ROUND = 64  # sides of what is round
THINGS = Path(__file__).with_suffix(".yaml")


def box(x: float, y: float, z: float) -> Manifold:
    """A box of so many millimetres."""
    return Manifold.cube((x, y, z), center=True)


def disc(radius: float, height: float, top: float | None = None) -> Manifold:
    """A disc, mm, standing on z = 0, with another radius at its top."""
    return Manifold.cylinder(height, radius, radius if top is None else top, _ROUND)


def rod(length: float, radius: float, end: float | None = None) -> Manifold:
    """A rod, mm, along +x from the origin."""
    return disc(radius, length, end).rotate((0.0, 90.0, 0.0))


def vessel(radius: float, top: float, height: float, wall: float) -> Manifold:
    """A round vessel, mm, open above."""
    inner = disc(radius - wall, height, top - wall).translate((0.0, 0.0, wall))
    return disc(radius, height, top) - inner


def loop(reach: float, height: float, thick: float) -> Manifold:
    """A handle: a closed ring, mm, in the x-z plane about the origin."""
    ring = CrossSection.circle(thick, 16).translate((reach, 0.0))
    return ring.revolve(48).rotate((90.0, 0.0, 0.0)).scale((1.0, 1.0, height / reach))


def bowl(radius: float, height: float, foot: float, wall: float) -> Manifold:
    """A bowl, mm: a foot, and a wall that is a quarter of an ellipse."""
    turns = [math.pi / 2.0 * k / 24 for k in range(25)]
    outer = [(foot + (radius - foot) * math.sin(t), height * (1.0 - math.cos(t))) for t in turns]
    inner = [(max(0.0, x - 0.8 * wall), z) for x, z in reversed(outer) if z > wall]
    return CrossSection([[(0.0, 0.0), *outer, *inner, (0.0, wall)]]).revolve(_ROUND)


def plate(radius: float) -> Manifold:
    """A plate, mm: a foot, a well and a rim that leans outwards, 17 mm high."""
    outer = [(0, 0), (0.6, 0), (0.7, 4), (1.0, 14), (1.0, 17), (0.97, 17), (0.66, 6), (0, 4)]
    return CrossSection([[(radius * x, float(z)) for x, z in outer]]).revolve(_ROUND)


def ball(x: float, y: float, z: float) -> Manifold:
    """A ball of three half axes, mm."""
    return Manifold.sphere(1.0, 48).scale((x, y, z))


def jug(body: list[float], handle: list[float], at: list[float]) -> Manifold:
    """A vessel with a loop at its side."""
    ring = loop(*handle).trim_by_plane((1.0, 0.0, 0.0), -2.0)
    return vessel(*body) + ring.translate(at)


def watering_can() -> Manifold:
    """A small watering can: a spout, and a handle at the other side."""
    spout = rod(150.0, 12.0, 9.0).rotate((0.0, -40.0, 0.0)).translate((50.0, 0.0, 30.0))
    ring = loop(42.0, 46.0, 8.0).trim_by_plane((-1.0, 0.0, 0.0), -2.0)
    body = vessel(62.0, 56.0, 125.0, 4.0)
    hollow = disc(58.0, 121.0, 52.0).translate((0.0, 0.0, 4.0))
    return body + (spout - hollow) + ring.translate((-57.0, 0.0, 70.0))


KINDS = {make.__name__: make for make in (box, disc, rod, vessel, loop, bowl, plate, ball, jug, watering_can)}


def solid(part: dict[str, Any]) -> Manifold:
    """Return a part of kitchen.yaml, mm."""
    (kind, given), *changes = part.items()
    made = reduce(add, map(solid, given)) if kind == "of" else KINDS[kind](*given)
    for name, value in changes:
        made = made - solid(value) if name == "less" else getattr(made, name)(*value)
    return made


class Kitchen(Script):
    """Writes the meshes and the two set files, held to their hash.

    Attributes:
        folder: where meshes and set files go.
    """

    folder: Argument[Folder]

    def run(self) -> int:
        differ = []
        for kind, things in yaml.safe_load(THINGS.read_text()).items():
            members, meshes = list[dict[str, Any]](), b""
            for name, (mass, part) in things.items():
                content, mesh = solid_obj(solid(part).scale((0.001,) * 3)), f"meshes/{name}.obj"
                write_atomically(self.folder / mesh, content)
                meshes += content
                source = f"dexgrasp, {kind}"
                members.append({"name": f"kitchen-{name}", "mesh": mesh, "mass": mass, "source": source})
            write_set(self.folder / f"{kind}.json", members)
            found = hashlib.sha256(repr(members).encode() + meshes).hexdigest()[:16]
            if found != DIGESTS.get(kind):
                differ.append(f"{kind}: {found}, not {DIGESTS.get(kind)}")
        if differ:
            print(f"these are not the frozen things: {'; '.join(differ)}", file=sys.stderr)
        return int(bool(differ))


if __name__ == "__main__":
    sys.exit(run_script(Kitchen))
