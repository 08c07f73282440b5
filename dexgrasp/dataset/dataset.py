"""A dataset read back: grasps of every rest pose as arrays, checked against the manifest."""

import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp.dataset.sampler import COUNTS
from dexgrasp.dataset.shards import FIELDS, file_hash, read_arrays, read_manifest
from dexgrasp.runs.shards import Arrays, text_of
from dexgrasp_env.errors import InputError

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class PoseGrasps:
    """The grasps of an object in one rest pose.

    Attributes:
        name: of the object.
        pose: index of the rest pose.
        scene: arrays of the rest pose: `cloud`, `points`, `normals`, `hull`, `centre`, `mass` (see
            shards.pose_arrays).
        grasps: arrays of `shards.FIELDS`, n grasps each.
        counts: how many were tried, placed, reached, feasible, holding.
        blocked: why postures were not feasible.
    """

    name: str
    pose: int
    scene: Arrays
    grasps: Arrays
    counts: dict[str, int]
    blocked: dict[str, int]

    def __len__(self) -> int:
        """Grasps."""
        return len(self.grasps["q"])

    @property
    def coverage(self) -> float:
        """Share of the candidate points that are nearest to some contact of a grasp."""
        points = self.scene["points"]
        if not len(self):
            return 0.0
        from scipy.spatial import cKDTree

        _, nearest = cKDTree(points).query(self.grasps["contacts"].reshape(-1, 3))
        return len(np.unique(nearest)) / len(points)


def read_dataset(folder: Path, check_hashes: bool = True) -> list[PoseGrasps]:
    """Read all rest poses of a complete dataset, in the order of the manifest.

    Raises:
        InputError: no dataset, not complete, files missing, cut off or changed.
    """
    manifest = read_manifest(folder)
    if not manifest.get("complete"):
        raise InputError(
            f"{folder} is not complete: run `dexgrasp dataset generate` with the same settings again"
        )
    found: list[PoseGrasps] = []
    for path, hashed in manifest["files"].items():
        if check_hashes and (folder / path).is_file() and file_hash(folder / path) != hashed:
            read_arrays(folder / path)  # says so where it is cut off
            raise InputError(
                f"{folder / path} was changed after it was made: remove it and run `dexgrasp dataset generate` again"
            )
    for path in sorted(p for p in manifest["files"] if p.startswith("poses/")):
        name, _, pose = Path(path).stem.rpartition("-pose")
        shards = sorted(p for p in manifest["files"] if p.startswith(f"grasps/{name}-pose{pose}-"))
        if not shards:
            raise InputError(
                f"{folder / 'manifest.json'} names no grasps of {path}: run `dexgrasp dataset generate` again"
            )
        found.append(_pose(folder, path, shards, name, int(pose), manifest["key"]))
    return found


def _pose(folder: Path, path: str, shards: list[str], name: str, pose: int, key: str) -> PoseGrasps:
    parts = [read_arrays(folder / shard, key) for shard in shards]
    counts, blocked = Counter[str](), Counter[str]()
    for part in parts:
        counts.update(dict(zip(COUNTS, part["counts"].tolist(), strict=True)))
        blocked.update(json.loads(text_of(part["blocked"])))
    grasps = {name: np.concatenate([part[name] for part in parts]) for name in FIELDS}
    return PoseGrasps(name, pose, read_arrays(folder / path, key), grasps, dict(counts), dict(blocked))
