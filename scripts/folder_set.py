"""Write a set file of the meshes of a folder: your own download, a scan session, another project's data.

    python scripts/folder_set.py ~/gso sets/gso.json --source "Google Scanned Objects, CC-BY 4.0"
    python scripts/folder_set.py $(python -c "import pybullet_data as p; print(p.getDataPath())")/random_urdfs \\
        sets/bullet.json --longest 0.08 --mass 0.1 --source "Bullet Physics, pybullet_data, zlib licence"
    dexgrasp evaluate --agents bilevel --objects sets/gso.json

The set file stands anywhere; meshes stay where they are. `source` of each object has the terms that you name and the
SHA-256 of its mesh. Meshes that cannot be read are named and left out.
"""

import argparse
import hashlib
import os
import re
import sys
from pathlib import Path
from typing import Any

import trimesh
from tqdm import tqdm

from dexgrasp_env.errors import InputError
from dexgrasp_env.files import write_json
from dexgrasp_env.objects.sets import SCHEMA, read_set

_KINDS = (".obj", ".stl", ".ply", ".glb")


def member(path: Path, folder: Path, out: Path, args: argparse.Namespace) -> dict[str, Any]:
    """Return a mesh's entry of the set file.

    Raises:
        InputError: the mesh cannot be read or has no extent.
    """
    content = path.read_bytes()
    scale = args.scale
    if args.longest is not None:
        try:
            extents = trimesh.load(path, force="mesh", process=False).extents
        except Exception as error:  # whatever a reader of meshes stumbles over
            raise InputError(f"{path}: cannot be read ({error})") from None
        if extents is None or not 0.0 < extents.max() < float("inf"):
            raise InputError(f"{path}: has no extent")
        scale = float(f"{args.longest / extents.max():.6g}")
    entry = {
        "name": re.sub(r"[^A-Za-z0-9_.-]+", "_", path.relative_to(folder).with_suffix("").as_posix())[-100:],
        "mesh": os.path.relpath(path, out.resolve().parent),
        "scale": scale,
        "mass": args.mass,
        "source": f"{args.source}; sha256 {hashlib.sha256(content).hexdigest()}",
    }
    return {key: value for key, value in entry.items() if value is not None}


def main() -> int:
    """Write the set file, and say what it leaves out."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="searched with its folders")
    parser.add_argument("out", type=Path, metavar="SET.json", help="the set file")
    parser.add_argument("--scale", type=float, default=1.0, help="factor to metres (default: %(default)s)")
    parser.add_argument("--longest", type=float, help="m: scale each mesh so that its longest side is this")
    parser.add_argument("--mass", type=float, help="kg, of each (default: by volume)")
    parser.add_argument("--source", default="unknown terms", help="where they are from, under which licence")
    parser.add_argument(
        "--most", type=int, default=1000, help="stop after so many meshes (default: %(default)s)"
    )
    args = parser.parse_args()
    folder = args.folder.resolve()
    paths = sorted(path for path in folder.rglob("*") if path.suffix.lower() in _KINDS and path.is_file())
    members = []
    for path in tqdm(paths[: args.most], unit="mesh", disable=None):
        try:
            members.append(member(path, folder, args.out, args))
        except InputError as error:
            print(f"left out: {error}", file=sys.stderr)
    if not members:
        print(f"{folder}: no mesh ({', '.join(_KINDS)}) that can be read", file=sys.stderr)
        return 2
    args.out.parent.mkdir(parents=True, exist_ok=True)
    write_json(args.out, {"schema": SCHEMA, "objects": members})
    try:
        print(f"{args.out}: {len(read_set(str(args.out)))} objects")
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
