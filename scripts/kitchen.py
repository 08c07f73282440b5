"""Write `flat.json` and `handled.json`: what lies low on a table, and what is borne by a handle.

    python scripts/kitchen.py sets/kitchen
    dexgrasp evaluate --agents hardcoded bilevel --objects sets/kitchen/flat.json --trials 5

Names, sizes and masses are frozen: `DIGEST` is the hash of all meshes and masses, and what differs is said.
"""

import hashlib
import sys

from manifold3d import CrossSection, Manifold
from outside import solid_obj
from set_files import write_set

from dexgrasp.cli.command import Argument, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp_env.files import write_atomically

DIGEST = "409a3b30e57a117e"
_ROUND = 64  # sides of what is round
Made = tuple[Manifold, float]


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


def plate(radius: float) -> Manifold:
    """A plate, mm: a foot, a well and a rim that leans outwards, 17 mm high."""
    outer = [(0, 0), (0.6, 0), (0.7, 4), (1.0, 14), (1.0, 17), (0.97, 17), (0.66, 6), (0, 4)]
    return CrossSection([[(radius * x, float(z)) for x, z in outer]]).revolve(_ROUND)


def spoon() -> Manifold:
    """A table spoon, mm, lying with its bowl up."""
    ball = Manifold.sphere(1.0, 48)
    bowl = ball.scale((30.0, 20.0, 12.0)) - ball.scale((28.0, 18.0, 10.5)).translate((0.0, 0.0, 2.0))
    bowl = bowl.trim_by_plane((0.0, 0.0, -1.0), 0.0)
    return bowl + box(125.0, 9.0, 3.0).translate((88.0, 0.0, -1.5))


def flat() -> dict[str, Made]:
    """Return the low things by name: m, kg."""
    made = {}
    for height in (12, 15, 18, 20):
        made[f"box-60x40x{height}"] = box(60.0, 40.0, height), 0.08
        made[f"box-120x80x{height}"] = box(120.0, 80.0, height), 0.15
        made[f"disc-80x{height}"] = disc(40.0, height), 0.1
    made |= {"plate-160": (plate(80.0), 0.2), "plate-200": (plate(100.0), 0.25)}
    made |= {
        "book-150x105x10": (box(150.0, 105.0, 10.0), 0.15),
        "book-190x130x15": (box(190.0, 130.0, 15.0), 0.25),
    }
    made |= {"phone": (box(147.0, 71.0, 8.0), 0.18), "spoon": (spoon(), 0.08)}
    return made | {"card": (box(86.0, 54.0, 1.0), 0.08)}


def pan() -> Made:
    """A frying pan of 20 cm with a handle of 16 cm at its rim."""
    handle = box(165.0, 24.0, 14.0).translate((175.0, 0.0, 34.0))
    return vessel(82.0, 100.0, 42.0, 4.0) + handle, 0.45


def ladle() -> Made:
    """A soup ladle."""
    stem = rod(240.0, 6.0, 7.0).rotate((0.0, -12.0, 0.0)).translate((38.0, 0.0, 32.0))
    return vessel(28.0, 42.0, 36.0, 3.0) + stem, 0.12


def mug() -> Made:
    """A mug of 3 dl."""
    ring = loop(24.0, 32.0, 5.0).trim_by_plane((1.0, 0.0, 0.0), -2.0)
    return vessel(40.0, 41.0, 95.0, 4.0) + ring.translate((40.0, 0.0, 48.0)), 0.3


def hammer() -> Made:
    """A claw hammer as large as a real one, of one density."""
    head = box(28.0, 110.0, 28.0).translate((0.0, 0.0, 14.0))
    return head + rod(270.0, 13.0, 15.0).translate((0.0, 0.0, 14.0)), 0.45


def jug() -> Made:
    """A jug of 1.5 l with a handle."""
    ring = loop(34.0, 60.0, 9.0).trim_by_plane((1.0, 0.0, 0.0), -2.0)
    return vessel(52.0, 46.0, 190.0, 4.0) + ring.translate((47.0, 0.0, 105.0)), 0.45


def drill() -> Made:
    """A cordless drill's shape: a barrel, a grip and a battery."""
    barrel = rod(170.0, 26.0, 20.0).translate((-70.0, 0.0, 170.0))
    return barrel + box(38.0, 34.0, 130.0).translate((-35.0, 0.0, 95.0)) + box(90.0, 66.0, 44.0).translate(
        (-25.0, 0.0, 22.0)
    ), 0.6


def brush() -> Made:
    """A hand brush."""
    bristles = box(110.0, 40.0, 34.0).translate((0.0, 0.0, 17.0))
    return bristles + box(280.0, 26.0, 20.0).translate((85.0, 0.0, 44.0)), 0.12


def watering_can() -> Made:
    """A small watering can: a spout, and a handle at the other side."""
    spout = rod(150.0, 12.0, 9.0).rotate((0.0, -40.0, 0.0)).translate((50.0, 0.0, 30.0))
    ring = loop(42.0, 46.0, 8.0).trim_by_plane((-1.0, 0.0, 0.0), -2.0)
    body = vessel(62.0, 56.0, 125.0, 4.0)
    hollow = disc(58.0, 121.0, 52.0).translate((0.0, 0.0, 4.0))
    return body + (spout - hollow) + ring.translate((-57.0, 0.0, 70.0)), 0.35


def handled() -> dict[str, Made]:
    """Return what has a handle by name: mm, kg."""
    return {
        "pan": pan(), "ladle": ladle(), "mug": mug(), "hammer": hammer(), "jug": jug(), "drill": drill(),
        "brush": brush(), "watering-can": watering_can(),
    }  # fmt: skip


def members(made: dict[str, Made], kind: str) -> list[dict[str, object]]:
    """Return the entries of a set file."""
    return [
        {"name": f"kitchen-{name}", "mesh": f"meshes/{name}.obj", "mass": mass, "source": f"dexgrasp, {kind}"}
        for name, (_, mass) in made.items()
    ]


class Kitchen(Script):
    """Writes the meshes and the two set files, held to their hash.

    Attributes:
        folder: where meshes and set files go.
    """

    folder: Argument[Folder]

    def run(self) -> int:
        sets = {"flat": flat(), "handled": handled()}
        entries = {kind: members(made, kind) for kind, made in sets.items()}
        meshes = {
            name: solid_obj(solid.scale((0.001,) * 3))
            for made in sets.values()
            for name, (solid, _) in made.items()
        }
        for name, content in meshes.items():
            write_atomically(self.folder / "meshes" / f"{name}.obj", content)
        for kind, own in entries.items():
            write_set(self.folder / f"{kind}.json", own)
        whole = repr([entry for own in entries.values() for entry in own]).encode() + b"".join(
            meshes.values()
        )
        if (found := hashlib.sha256(whole).hexdigest()[:16]) != DIGEST:
            print(f"these are not the frozen things: {found}, not {DIGEST}", file=sys.stderr)
            return 1
        return 0


if __name__ == "__main__":
    sys.exit(run_script(Kitchen))
