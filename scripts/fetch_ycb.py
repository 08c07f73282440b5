"""Fetch meshes of the YCB Object and Model Set from their publisher and write a set file of them.

    python scripts/fetch_ycb.py sets/ycb.json                      what would be fetched, and from where
    python scripts/fetch_ycb.py sets/ycb.json --yes                 fetch and write
    dexgrasp evaluate --agents bilevel --objects sets/ycb.json

The meshes go into the cache, are fetched once, and are their authors': each object has terms of its own
(https://www.ycbbenchmarks.com). Masses are the published ones.
"""

import io
import sys
import tarfile
import urllib.error
import urllib.request
from pathlib import Path
from typing import Annotated

from set_files import write_set
from tqdm import tqdm

from dexgrasp.cli.command import Argument, Script
from dexgrasp.cli.commands import run_script
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.files import cache_dir, write_atomically

PUBLISHER = "https://ycb-benchmarks.s3.amazonaws.com/data/google"
MASSES = {  # kg
    "003_cracker_box": 0.411, "004_sugar_box": 0.514, "005_tomato_soup_can": 0.349, "006_mustard_bottle": 0.603,
    "007_tuna_fish_can": 0.171, "009_gelatin_box": 0.097, "010_potted_meat_can": 0.370, "011_banana": 0.066,
    "013_apple": 0.068, "015_peach": 0.033, "017_orange": 0.047, "044_flat_screwdriver": 0.0984,
    "048_hammer": 0.665, "051_large_clamp": 0.125, "056_tennis_ball": 0.058, "058_golf_ball": 0.046,
    "065-a_cups": 0.013, "065-c_cups": 0.017, "065-e_cups": 0.021, "065-g_cups": 0.028, "065-i_cups": 0.035,
}  # fmt: skip
_MOST_BYTES = 200 * 2**20
_MESH = "google_16k/nontextured.ply"


def fetch(name: str, publisher: str) -> Path:
    """Return the mesh of an object in the cache, fetched if it is not there.

    Raises:
        InputError: it cannot be fetched, or is not what it should be.
    """
    path = cache_dir() / "ycb" / f"{name}.ply"
    if not path.is_file():
        write_atomically(path, _mesh_of(_download(f"{publisher}/{name}_google_16k.tgz"), name))
    return path


def _download(url: str) -> bytes:
    try:
        with urllib.request.urlopen(url, timeout=60) as answer:
            content = bytes(answer.read(_MOST_BYTES + 1))
    except (urllib.error.URLError, OSError, ValueError) as error:
        raise InputError(f"cannot fetch {url}: {error}") from None
    if len(content) > _MOST_BYTES:
        raise InputError(f"{url} is larger than {_MOST_BYTES // 2**20} MB: that is no mesh of the set")
    return content


def _mesh_of(archive: bytes, name: str) -> bytes:
    """Return the one file that is wanted of an archive; nothing is unpacked to disk."""
    try:
        with tarfile.open(fileobj=io.BytesIO(archive), mode="r:gz") as tar:
            file = tar.extractfile(f"{name}/{_MESH}")
            content = b"" if file is None else file.read(_MOST_BYTES)
    except (tarfile.TarError, KeyError, EOFError, OSError) as error:
        raise InputError(f"the archive of {name} holds no {_MESH} ({error})") from None
    if not content.startswith(b"ply"):
        raise InputError(f"{_MESH} in the archive of {name} is no ply file")
    return content


class Fetch(Script):
    """Fetches, and writes the set file.

    Attributes:
        set_file: set file to write.
        objects: which (default: all).
        yes: fetch; without it only what would be done is said.
        publisher: where they are.
    """

    set_file: Argument[Annotated[Path, "FILE.json"]]
    objects: Annotated[tuple[str, ...], "NAME"] = tuple(MASSES)
    yes: bool = False
    publisher: Annotated[str, "URL"] = PUBLISHER

    def run(self) -> int:
        for name in self.objects:
            if name not in MASSES:
                raise unknown_name("object", name, MASSES)
        if not self.yes:
            print(
                f"{len(self.objects)} archives of up to a few MB each would be fetched from {self.publisher}"
            )
            print(
                f"into {cache_dir() / 'ycb'}; their terms: https://www.ycbbenchmarks.com. Give --yes to do it."
            )
            return 0
        with tqdm(self.objects, unit="mesh", file=sys.stderr) as bar:
            meshes = {name: fetch(name, self.publisher) for name in bar}
        write_set(
            self.set_file,
            [
                {"name": f"ycb_{name}", "mesh": str(path), "mass": MASSES[name], "source": self.publisher}
                for name, path in meshes.items()
            ],
        )
        return 0


if __name__ == "__main__":
    sys.exit(run_script(Fetch))
