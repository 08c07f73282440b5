"""Write a set file of the meshes of a folder: your own download, a scan session, another project's data.

    python scripts/folder_set.py ~/gso sets/gso.json --source "Google Scanned Objects, CC-BY 4.0"
    python scripts/folder_set.py $(python -c "import pybullet_data as p; print(p.getDataPath())")/random_urdfs \\
        sets/bullet.json --longest 0.08 --mass 0.1 --source "Bullet Physics, pybullet_data, zlib licence"
    dexgrasp evaluate --agents bilevel --objects sets/gso.json

The set file stands anywhere; meshes stay where they are. `source` of each object has the terms that you name and the
SHA-256 of its mesh. Meshes that cannot be read are named and left out.
"""

import os
import re
import sys
from pathlib import Path
from typing import Annotated, Any

import trimesh
from set_files import write_set
from tqdm import tqdm

from dexgrasp.cli.command import Argument, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import file_hash
from dexgrasp_env.objects.sets import MESH_SUFFIXES
from dexgrasp_env.valid import Count, Positive


class FolderSet(Script):
    """Writes the set file, and says what it leaves out.

    Attributes:
        folder: searched with its folders.
        out: the set file.
        scale: factor to metres.
        longest: m; scale each mesh so that its longest side is this.
        mass: kg, of each (default: by volume).
        source: where they are from, under which licence.
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
        paths = sorted(
            p for p in self.folder.resolve().rglob("*") if p.suffix.lower() in MESH_SUFFIXES and p.is_file()
        )
        members = []
        for path in tqdm(paths[: self.most], unit="mesh", disable=None):
            try:
                members.append(self.member(path))
            except InputError as error:
                print(f"left out: {error}", file=sys.stderr)
        if not members:
            raise InputError(f"{self.folder}: no mesh ({', '.join(MESH_SUFFIXES)}) that can be read")
        write_set(self.out, members)
        return 0

    def member(self, path: Path) -> dict[str, Any]:
        """Return a mesh's entry of the set file.

        Raises:
            InputError: the mesh cannot be read or has no extent.
        """
        name, scale = path.relative_to(self.folder.resolve()).with_suffix("").as_posix(), self.scale
        if self.longest is not None:
            try:
                extents = trimesh.load(path, force="mesh", process=False).extents
            except Exception as error:  # whatever a reader of meshes stumbles over
                raise InputError(f"{path}: cannot be read ({error})") from None
            if extents is None or not 0.0 < extents.max() < float("inf"):
                raise InputError(f"{path}: has no extent")
            scale = float(f"{self.longest / extents.max():.6g}")
        entry = {
            "name": re.sub(r"[^A-Za-z0-9_.-]+", "_", name)[-100:],
            "mesh": os.path.relpath(path, self.out.resolve().parent),
            "scale": scale,
            "mass": self.mass,
            "source": f"{self.source}; sha256 {file_hash(path)}",
        }
        return {key: value for key, value in entry.items() if value is not None}


if __name__ == "__main__":
    sys.exit(run_script(FolderSet))
