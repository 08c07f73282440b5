"""Sets of objects that the catalogue does not have, and the shells of the robot that are shown.

    python scripts/object_sets.py outside sets/outside      a thousand shapes: develop.json (700) and final.json (300)
    python scripts/object_sets.py kitchen sets/kitchen      flat.json, handled.json and wide.json, of kitchen.yaml
    python scripts/object_sets.py ycb sets/ycb.json --yes   scans of the YCB set, from their publisher, once
    python scripts/object_sets.py folder ~/gso sets/gso.json --source "Google Scanned Objects, CC-BY 4.0"
    python scripts/object_sets.py shells assets/robot/shells
    dexgrasp evaluate --agents bilevel --objects sets/outside/develop.json --trials 1

`outside` and `kitchen` are frozen by hashes (outside.json, `KITCHEN`): a mesh that differs is named and the exit code
is 1. The 300 shapes of `final.json` are for figures of record alone. Scans are their authors': each has terms of its
own (https://www.ycbbenchmarks.com).
"""

import hashlib
import io
import json
import os
import re
import sys
import tarfile
import urllib.request
from collections.abc import Callable, Sequence
from functools import reduce
from operator import add
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import trimesh
import yaml
from manifold3d import CrossSection, Manifold
from numpy.random import Generator
from shell_fields import shell
from tqdm import tqdm

from dexgrasp.cli.command import Argument, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.files import cache_dir, file_hash, write_atomically, write_json
from dexgrasp_env.objects.sets import MESH_SUFFIXES, SCHEMA, read_set
from dexgrasp_env.valid import Count, Positive

HERE = Path(__file__).parent
HASHES = HERE / "outside.json"
KITCHEN = {"flat": "b9a4e040b5ee3652", "handled": "e44163e26b837fa2", "wide": "2df87f31181d5245"}
COUNT, FINAL, SEED = 1000, 300, 1848
_SIZE, _LEAST = (0.05, 0.13), 0.022  # m, longest and shortest side
_DENSITY, _MASS = (150.0, 900.0), (0.02, 0.5)  # kg/m3, kg
_MOST_BYTES = 200 * 2**20  # of an archive
Member = dict[str, Any]


def write_set(path: Path, members: Sequence[Member]) -> None:
    """Write a set file, whose meshes are there.

    Raises:
        InputError: if it cannot be read again.
    """
    write_json(path, {"schema": SCHEMA, "objects": members})
    print(f"wrote {path}: {len(read_set(str(path)))} objects")


def obj_of(corners: Any, faces: Any) -> bytes:
    """Return a mesh as an obj file; corners to a hundredth of a millimetre, so that rounding changes no bit."""
    lines = [f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in corners]
    lines += [f"f {a} {b} {c}" for a, b, c in faces + 1]
    return "\n".join([*lines, ""]).encode()


def solid_obj(solid: Manifold) -> bytes:
    """Return a solid as an obj file."""
    mesh = solid.to_mesh()
    return obj_of(np.asarray(mesh.vert_properties)[:, :3] + 0.0, np.asarray(mesh.tri_verts))


def member_of(
    folder: Path, name: str, solid: Manifold, mass: float, kind: str, prefix: str = ""
) -> tuple[Member, bytes]:
    """Write a solid's mesh; return its entry of a set file, and the mesh."""
    content, mesh = solid_obj(solid), f"meshes/{name}.obj"
    write_atomically(folder / mesh, content)
    return {"name": prefix + name, "mesh": mesh, "mass": mass, "source": f"dexgrasp, {kind}"}, content


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


# -- outside: kinds of shapes that the catalogue's builders do not make -------------------------------------------


def blob(rng: Generator) -> Manifold:
    """A sphere swollen and dented by a few smooth bumps."""
    ways = rng.normal(size=(rng.integers(3, 8), 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    heights, widths = rng.uniform(-0.3, 0.45, len(ways)), rng.uniform(1.5, 6.0, len(ways))

    def bumps(points: np.ndarray) -> np.ndarray:
        """Return unit points (N, 3) moved out and in."""
        swell = (heights * np.exp(widths * (points @ ways.T - 1.0))).sum(axis=1)
        return points * (1.0 + swell)[:, None]

    return Manifold.sphere(1.0, 48).warp_batch(bumps).scale(rng.uniform((0.6, 0.6, 0.5), 1.0))


def extrusion(rng: Generator) -> Manifold:
    """A star-like outline, drawn up with a taper and a twist."""
    outline = _outline(rng, int(rng.integers(3, 11)), rng.uniform(0.0, 0.45))
    return outline.extrude(rng.uniform(0.5, 3.0), 24, rng.uniform(-70.0, 70.0), (rng.uniform(0.5, 1.0),) * 2)


def revolution(rng: Generator) -> Manifold:
    """A smooth profile about an axis: vases, spindles, knobs."""
    height = np.linspace(0.0, rng.uniform(1.0, 4.0), 40)
    waves = sum(
        rng.uniform(-0.35, 0.35) * np.sin((k + 1) * np.pi * height / height[-1] + rng.uniform(0, 6.28))
        for k in range(4)
    )
    radius = np.clip(0.7 + waves, 0.15, None)
    profile = [(0.0, 0.0), *zip(radius.tolist(), height.tolist(), strict=True), (0.0, float(height[-1]))]
    return CrossSection([profile]).revolve(48)


def pieces(rng: Generator) -> Manifold:
    """Two to five solids joined, and one to three holes: toys, fittings, tools."""
    whole = _solid(rng)
    for _ in range(int(rng.integers(1, 5))):
        whole += _solid(rng).rotate(rng.uniform(0.0, 360.0, 3)).translate(rng.uniform(-0.6, 0.6, 3))
    for _ in range(int(rng.integers(1, 4))):
        drill = Manifold.cylinder(8.0, rng.uniform(0.08, 0.25), circular_segments=24, center=True)
        whole -= drill.rotate(rng.uniform(0.0, 360.0, 3)).translate(rng.uniform(-0.5, 0.5, 3))
    return max(whole.decompose(), key=lambda part: part.volume())


def handled(rng: Generator) -> Manifold:
    """A body with a handle at its side: a bar or a loop."""
    body = (revolution if rng.random() < 0.5 else extrusion)(rng)
    x0, y0, z0, x1, y1, z1 = body.bounding_box()
    tall, thick = z1 - z0, rng.uniform(0.08, 0.16) * (z1 - z0)
    side = np.array([x1, 0.5 * (y0 + y1), z0 + tall * rng.uniform(0.4, 0.7)])
    if rng.random() < 0.5:
        length = rng.uniform(0.8, 1.6) * max(x1 - x0, tall)
        bar = Manifold.cylinder(length, 1.2 * thick, 0.8 * thick, 24).rotate((0.0, 90.0, 0.0))
        return body + bar.translate(side - (0.3 * (x1 - x0), 0.0, 0.0))
    ring = CrossSection.circle(thick, 16).translate((rng.uniform(0.25, 0.4) * tall, 0.0)).revolve(32)
    return body + ring.rotate((90.0, 0.0, 0.0)).translate(side)


def walled(rng: Generator) -> Manifold:
    """Thin walls about a hollow: bowls, trays, caps, pipes."""
    outline = _outline(rng, int(rng.integers(5, 24)), rng.uniform(0.0, 0.15))
    height, wall = rng.uniform(0.6, 2.2), rng.uniform(0.06, 0.14)
    top = (rng.uniform(0.75, 1.3),) * 2
    outer = outline.extrude(height, 1, 0.0, top)
    floor = -0.1 if rng.random() < 0.25 else wall
    inner = outline.offset(-wall).extrude(height + 0.2, 1, 0.0, top).translate((0.0, 0.0, floor))
    return outer - inner


_KINDS: tuple[Callable[[Generator], Manifold], ...] = (blob, extrusion, revolution, pieces, handled, walled)


def shape(number: int) -> tuple[Manifold, str, float]:
    """Return shape `number`, m, the name of its kind, and its mass, kg."""
    kind = _KINDS[number % len(_KINDS)]
    for attempt in range(100):
        rng = np.random.default_rng([SEED, number, attempt])
        solid = _sized(kind(rng), rng)
        if solid is not None:
            mass = float(np.clip(solid.volume() * rng.uniform(*_DENSITY), *_MASS))
            return solid, kind.__name__, round(mass, 3)
    raise RuntimeError(f"no shape of kind {kind.__name__} for number {number}")


def _sized(solid: Manifold, rng: Generator) -> Manifold | None:
    low, high = np.array(solid.bounding_box()).reshape(2, 3)
    sides = high - low
    if solid.is_empty() or len(solid.decompose()) != 1:
        return None
    factor = rng.uniform(*_SIZE) / sides.max()
    if factor * sides.min() < _LEAST:
        return None
    return solid.translate(-0.5 * (low + high)).scale((factor,) * 3)


def _outline(rng: Generator, corners: int, depth: float) -> CrossSection:
    angle = 2.0 * np.pi * (np.arange(corners) + rng.uniform(-0.25, 0.25, corners)) / corners
    radius = 1.0 - depth * rng.random(corners)
    points = np.column_stack([radius * np.cos(angle), rng.uniform(0.6, 1.0) * radius * np.sin(angle)])
    return CrossSection([points.tolist()])


def _solid(rng: Generator) -> Manifold:
    if rng.random() < 0.5:
        return Manifold.cube(rng.uniform(0.4, 1.4, 3), center=True)
    return Manifold.cylinder(rng.uniform(0.4, 1.8), *rng.uniform(0.2, 0.7, 2), 32, center=True)


def split() -> tuple[list[int], list[int]]:
    """Return the numbers to develop on and those for figures of record."""
    order = sorted(range(COUNT), key=lambda k: hashlib.sha256(f"outside-{k:04d}/{SEED}".encode()).digest())
    return sorted(order[FINAL:]), sorted(order[:FINAL])


class Outside(Script):
    """Writes a thousand shapes by no builder of the catalogue.

    Attributes:
        folder: where meshes and set files go.
    """

    folder: Argument[Folder]

    def run(self) -> int:
        found, members = {}, {}
        for number in tqdm(range(COUNT), unit="shape", disable=None):
            name, (solid, kind, mass) = f"outside-{number:04d}", shape(number)
            members[number], content = member_of(self.folder, name, solid, mass, kind)
            found[name] = _hash(content)
        for numbers, file in zip(split(), ("develop.json", "final.json"), strict=True):
            write_set(self.folder / file, [members[k] for k in numbers])
        return _differing(found, json.loads(HASHES.read_text()))


def _differing(found: dict[str, str], frozen: dict[str, str]) -> int:
    wrong = [name for name, value in frozen.items() if found.get(name) != value]
    if wrong:
        print(
            f"{len(wrong)} of {len(frozen)} are not as they were frozen, {wrong[0]} the first",
            file=sys.stderr,
        )
    return int(bool(wrong))


# -- kitchen: parts of kitchen.yaml, mm --------------------------------------------------------------------------


def solid(part: dict[str, Any]) -> Any:
    """Return a part of kitchen.yaml, mm."""
    (kind, given), *changes = part.items()
    if kind == "less":
        hollow = solid(given)
        return solid(dict(changes)) - hollow
    if kind in ("of", "onto"):
        made = reduce(add, list(map(solid, given))[:: 1 if kind == "of" else -1])
    elif kind == "spouted":
        spout, handle, body, hollow = map(solid, given)
        made = body + (spout - hollow) + handle
    elif kind == "polygon":
        made = CrossSection([given])
    else:
        made = getattr(CrossSection if kind == "circle" else Manifold, kind)(*given)
    for name, value in changes:
        made = made - solid(value) if name == "less" else getattr(made, name)(*value)
    return made


class Kitchen(Script):
    """Writes what lies low, what has a handle, bowls, pots and trays.

    Attributes:
        folder: where meshes and set files go.
    """

    folder: Argument[Folder]

    def run(self) -> int:
        found = {}
        for kind, things in yaml.safe_load((HERE / "kitchen.yaml").read_text()).items():
            made = [
                member_of(self.folder, name, solid(part).scale((0.001,) * 3), mass, kind, "kitchen-")
                for name, (mass, part) in things.items()
            ]
            members = [member for member, _ in made]
            write_set(self.folder / f"{kind}.json", members)
            found[kind] = _hash(repr(members).encode() + b"".join(content for _, content in made))
        return _differing(found, KITCHEN)


# -- scans and folders of meshes ---------------------------------------------------------------------------------


def fetch(name: str, publisher: str) -> Path:
    """Return the mesh of a YCB object in the cache, fetched if it is not there; nothing is unpacked to disk.

    Raises:
        InputError: it cannot be fetched, or is not what it should be.
    """
    path, url = cache_dir() / "ycb" / f"{name}.ply", f"{publisher}/{name}_google_16k.tgz"
    if path.is_file():
        return path
    try:
        with urllib.request.urlopen(url, timeout=60) as answer:
            content = answer.read(_MOST_BYTES)
        with tarfile.open(fileobj=io.BytesIO(content), mode="r:gz") as tar:
            file = tar.extractfile(f"{name}/google_16k/nontextured.ply")
            mesh = b"" if file is None else file.read(_MOST_BYTES)
    except (tarfile.TarError, KeyError, EOFError, OSError, ValueError) as error:
        raise InputError(f"cannot fetch {url}: {error}") from None
    if not mesh.startswith(b"ply"):
        raise InputError(f"{url} holds no ply file")
    write_atomically(path, mesh)
    return path


class Ycb(Script):
    """Fetches meshes of the YCB Object and Model Set, with their published masses.

    Attributes:
        out: set file to write.
        objects: which (default: all).
        yes: fetch; without it only what would be done is said.
        publisher: where they are.
    """

    out: Argument[Annotated[Path, "SET.json"]]
    objects: Annotated[tuple[str, ...], "NAME"] = ()
    yes: bool = False
    publisher: Annotated[str, "URL"] = "https://ycb-benchmarks.s3.amazonaws.com/data/google"

    def run(self) -> int:
        masses = yaml.safe_load((HERE / "ycb.yaml").read_text())
        names = self.objects or tuple(masses)
        for name in names:
            if name not in masses:
                raise unknown_name("object", name, masses)
        if not self.yes:
            print(f"{len(names)} archives of a few MB each would be fetched from {self.publisher}")
            print(
                f"into {cache_dir() / 'ycb'}; their terms: https://www.ycbbenchmarks.com. Give --yes to do it."
            )
            return 0
        meshes = {name: str(fetch(name, self.publisher)) for name in tqdm(names, unit="mesh", disable=None)}
        about = {"source": self.publisher}
        write_set(
            self.out, [{"name": f"ycb_{k}", "mesh": v, "mass": masses[k], **about} for k, v in meshes.items()]
        )
        return 0


class FolderSet(Script):
    """Writes a set file of a folder's meshes, which stay where they are; what cannot be read is named and left out.

    Attributes:
        folder: searched with its folders.
        out: the set file.
        scale: factor to metres.
        longest: m; scale each mesh so that its longest side is this.
        mass: kg, of each (default: by volume).
        source: where they are from, under which licence; the hash of each mesh is added.
        most: stop after so many meshes.
    """

    folder: Argument[Folder]
    out: Argument[Annotated[Path, "SET.json"]]
    scale: Positive = 1.0
    longest: Positive | None = None
    mass: Positive | None = None
    source: str = "unknown terms"
    most: Count = 1000

    def run(self) -> int:
        root, members = self.folder.resolve(), []
        paths = sorted(p for p in root.rglob("*") if p.suffix.lower() in MESH_SUFFIXES and p.is_file())
        for path in tqdm(paths[: self.most], unit="mesh", disable=None):
            try:
                members.append(self.member(path, path.relative_to(root).with_suffix("").as_posix()))
            except InputError as error:
                print(f"left out: {error}", file=sys.stderr)
        if not members:
            raise InputError(f"{self.folder}: no mesh ({', '.join(MESH_SUFFIXES)}) that can be read")
        write_set(self.out, members)
        return 0

    def member(self, path: Path, name: str) -> Member:
        """Return a mesh's entry of the set file.

        Raises:
            InputError: the mesh cannot be read or has no extent.
        """
        scale = self.scale
        if self.longest is not None:
            try:
                longest = trimesh.load(path, force="mesh", process=False).extents.max()
                scale = float(f"{self.longest / longest:.6g}")
            except Exception as error:  # whatever a reader of meshes stumbles over
                raise InputError(f"{path}: cannot be read ({error})") from None
            if not 0.0 < scale < float("inf"):
                raise InputError(f"{path}: has no extent")
        return {
            "name": re.sub(r"[^A-Za-z0-9_.-]+", "_", name)[-100:],
            "mesh": os.path.relpath(path, self.out.resolve().parent),
            "scale": scale,
            **({} if self.mass is None else {"mass": self.mass}),
            "source": f"{self.source}; sha256 {file_hash(path)}",
        }


class Shells(Script):
    """Meshes the shells of the robot that are shown; collision uses none of them.

    Attributes:
        folder: where they go.
    """

    folder: Argument[Folder]

    def run(self) -> int:
        from fast_simplification import simplify

        shells, ticks = yaml.safe_load((HERE / "shells.yaml").read_text()), np.arange(-0.4, 0.4, 0.02)
        for part, step, faces in (("arm", 0.005, 1800), ("hand", 0.002, 500)):
            for name, content in shells[part].items():
                field = shell(**content)
                near = np.array(
                    [(x, y, z) for x in ticks for y in ticks for z in ticks if field(x, y, z) < 0.01]
                )
                bounds = [*(near.min(0) - 0.02), *(near.max(0) + 0.02)]
                mesh = Manifold.level_set(lambda *place, field=field: -field(*place), bounds, step).to_mesh()
                corners, triangles = (
                    np.array(mesh.vert_properties[:, :3], float),
                    np.array(mesh.tri_verts, np.int32),
                )
                if len(triangles) > faces:
                    corners, triangles = simplify(corners, triangles, target_count=faces, agg=3)
                (self.folder / f"{name}.obj").write_bytes(obj_of(corners, triangles))
        return 0


if __name__ == "__main__":
    kinds = {"outside": Outside, "kitchen": Kitchen, "ycb": Ycb, "folder": FolderSet, "shells": Shells}
    sys.exit(run_script(kinds))
