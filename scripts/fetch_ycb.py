"""Fetch meshes of the YCB Object and Model Set from their publisher and write a set file of them.

    python scripts/fetch_ycb.py sets/ycb.json                      what would be fetched, and from where
    python scripts/fetch_ycb.py sets/ycb.json --yes                 fetch and write
    dexgrasp evaluate --agents bilevel --objects sets/ycb.json

The meshes go into the cache, are fetched once, and are their authors': each object has terms of its own
(https://www.ycbbenchmarks.com). Masses are the published ones.
"""

import argparse
import io
import sys
import tarfile
import urllib.error
import urllib.request
from pathlib import Path

from tqdm import tqdm

from dexgrasp_env.errors import InputError
from dexgrasp_env.files import cache_dir, write_atomically, write_json
from dexgrasp_env.objects.sets import SCHEMA, read_set

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


def main(argv: list[str] | None = None) -> int:
    """Fetch, and write the set file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("set_file", type=Path, metavar="FILE.json", help="set file to write")
    parser.add_argument(
        "--objects", nargs="+", default=list(MASSES), metavar="NAME", help="which (default: all)"
    )
    parser.add_argument(
        "--yes", action="store_true", help="fetch: without it only what would be done is said"
    )
    parser.add_argument("--publisher", default=PUBLISHER, metavar="URL", help="(default %(default)s)")
    args = parser.parse_args(argv)
    try:
        return _run(args)
    except InputError as error:
        print(f"fetch_ycb: {error}", file=sys.stderr)
        return 2


def _run(args: argparse.Namespace) -> int:
    for name in args.objects:
        if name not in MASSES:
            raise InputError(f"unknown object {name!r}: valid are {', '.join(MASSES)}")
    if not args.yes:
        print(f"{len(args.objects)} archives of up to a few MB each would be fetched from {args.publisher}")
        print(f"into {cache_dir() / 'ycb'}; their terms: https://www.ycbbenchmarks.com. Give --yes to do it.")
        return 0
    with tqdm(args.objects, unit="mesh", file=sys.stderr) as bar:
        meshes = {name: fetch(name, args.publisher) for name in bar}
    objects = [
        {"name": f"ycb_{name}", "mesh": str(path), "mass": MASSES[name], "source": args.publisher}
        for name, path in meshes.items()
    ]
    write_json(args.set_file, {"schema": SCHEMA, "objects": objects})
    print(f"wrote {args.set_file}: {len(read_set(str(args.set_file)))} objects")
    return 0


if __name__ == "__main__":
    sys.exit(main())
