"""Sets of objects that the catalogue does not have.

    python scripts/object_sets.py outside sets/outside      a thousand shapes: develop.json (700) and final.json (300)
    python scripts/object_sets.py kitchen sets/kitchen      flat.json, handled.json and wide.json, of kitchen.yaml
    python scripts/object_sets.py ycb sets/ycb.json --yes   scans of the YCB set, from their publisher, once
    dexgrasp evaluate --agents bilevel --objects sets/outside/develop.json --trials 1

`outside` and `kitchen` are frozen by hashes (outside.json, `KITCHEN`): a mesh that differs is named and the exit code
is 1. The 300 shapes of `final.json` are for figures of record alone. Scans are their authors': each has terms of its
own (https://www.ycbbenchmarks.com).
"""

import hashlib
import io
import json
import sys
import tarfile
import urllib.request
from collections.abc import Sequence
from functools import reduce
from operator import add
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from manifold3d import CrossSection, Manifold
from outside_shapes import SEED, shape
from tqdm import tqdm

from dexgrasp.cli.command import Argument, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.files import cache_dir, write_atomically, write_json
from dexgrasp_env.objects.sets import SCHEMA, read_set

HERE = Path(__file__).parent
HASHES = HERE / "outside.json"
KITCHEN = {"flat": "b9a4e040b5ee3652", "handled": "e44163e26b837fa2", "wide": "2df87f31181d5245"}
COUNT, FINAL = 1000, 300
_MOST_BYTES = 200 * 2**20  # of an archive
Member = dict[str, Any]


def write_set(path: Path, members: Sequence[Member]) -> None:
    """Write a set file, whose meshes are there.

    Raises:
        InputError: if it cannot be read again.
    """
    write_json(path, {"schema": SCHEMA, "objects": members})
    print(f"wrote {path}: {len(read_set(str(path)))} objects")


def solid_obj(solid: Manifold) -> bytes:
    """Return a solid as an obj file; corners to a hundredth of a millimetre, so that rounding changes no bit."""
    mesh = solid.to_mesh()
    corners = np.asarray(mesh.vert_properties)[:, :3] + 0.0
    lines = [f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in corners]
    lines += [f"f {a} {b} {c}" for a, b, c in np.asarray(mesh.tri_verts) + 1]
    return "\n".join([*lines, ""]).encode()


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


def split() -> tuple[list[int], list[int]]:
    """Return the numbers to develop on and those for figures of record."""
    order = sorted(range(COUNT), key=lambda k: hashlib.sha256(f"outside-{k:04d}/{SEED}".encode()).digest())
    return sorted(order[FINAL:]), sorted(order[:FINAL])


class Outside(Script):
    """Write a thousand shapes that no builder of the catalogue makes.

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
    """Write flat things, things with handles, bowls, pots and trays.

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


# -- scans ---------------------------------------------------------------------------------------------------------


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
    """Fetch meshes of the YCB Object and Model Set, with their published masses.

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
            print(
                f"{len(names)} archives of a few MB each would be fetched from {self.publisher}\n"
                f"into {cache_dir() / 'ycb'}; their terms: https://www.ycbbenchmarks.com. Give --yes to do it."
            )
            return 0
        meshes = {name: str(fetch(name, self.publisher)) for name in tqdm(names, unit="mesh", disable=None)}
        members = [
            {"name": f"ycb_{name}", "mesh": mesh, "mass": masses[name], "source": self.publisher}
            for name, mesh in meshes.items()
        ]
        write_set(self.out, members)
        return 0


if __name__ == "__main__":
    kinds = {"outside": Outside, "kitchen": Kitchen, "ycb": Ycb}
    sys.exit(run_script(kinds))
