"""A dataset read back: grasps of every rest pose as arrays, checked against the manifest."""

import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dexgrasp.dataset.sampler import COUNTS
from dexgrasp.dataset.shards import FIELDS, read_arrays, read_manifest
from dexgrasp.runs.shards import text_of
from dexgrasp_env.arrays import Arrays
from dexgrasp_env.errors import InputError


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


def read_dataset(folder: Path) -> list[PoseGrasps]:
    """Read all rest poses of a complete dataset, in the order of their names.

    Raises:
        InputError: no dataset, not complete, files missing, cut off or changed.
    """
    manifest = read_manifest(folder)
    if not manifest.get("complete"):
        raise InputError(
            f"{folder} is not complete: run `dexgrasp dataset generate` with the same settings again"
        )
    files = {
        name: read_arrays(folder / name, manifest["key"], hashed)
        for name, hashed in sorted(manifest["files"].items())
    }
    return [_pose(folder, name, files) for name in files if name.startswith("poses/")]


def _pose(folder: Path, name: str, files: dict[str, Arrays]) -> PoseGrasps:
    stem = Path(name).stem
    parts = [arrays for shard, arrays in files.items() if shard.startswith(f"grasps/{stem}-")]
    if not parts:
        raise InputError(f"{folder} has no grasps of {name}: run `dexgrasp dataset generate` again")
    counts, blocked = Counter[str](), Counter[str]()
    for part in parts:
        counts.update(dict(zip(COUNTS, part["counts"].tolist(), strict=True)))
        blocked.update(json.loads(text_of(part["blocked"])))
    grasps = {field: np.concatenate([part[field] for part in parts]) for field in FIELDS}
    label, _, pose = stem.rpartition("-pose")
    return PoseGrasps(label, int(pose), files[name], grasps, dict(counts), dict(blocked))
