"""Files of a dataset (shards, rest poses, the manifest), and a reader that checks them against the manifest."""

import json
import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np

from dexgrasp.data.dataset.rest_scene import RestScene
from dexgrasp.data.dataset.sampler import COUNTS, ShardGrasps
from dexgrasp.data.dataset.settings import SCHEMA
from dexgrasp.runs.shards import bytes_of, read_shard, text_of
from dexgrasp_env.arrays import Arrays, Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import expand, file_hash, read_json_object
from dexgrasp_env.robot.robot import Robot
from dexgrasp_env.valid import TEXT, Rule, read
from dexgrasp_env.yaml_file import read_yaml

MANIFEST = "manifest.json"

FIELDS: dict[str, Fields] = read_yaml(Path(__file__).with_name("fields.yaml"))
"""Field -> shape for one grasp, type and meaning, from fields.yaml."""


def fields_of(robot: Robot) -> dict[str, Fields]:
    """Return the fields, with their shapes for a robot; further fingers follow the first three of a grasp."""
    fingers = len(robot.hand.grasp)
    sizes = {"joints": robot.dof, "fingers": fingers, "corners": min(fingers, 3)}
    return {
        name: words | {"shape": [sizes.get(size, size) for size in words["shape"]]}
        for name, words in FIELDS.items()
    }


def shard_arrays(found: ShardGrasps, robot: Robot) -> Arrays:
    """Return the arrays of a shard's file: fields of its grasps, counts, and why postures were infeasible."""
    arrays: Arrays = {
        name: np.array([grasp[name] for grasp in found.grasps], words["type"]).reshape(
            len(found), *words["shape"]
        )
        for name, words in fields_of(robot).items()
    }
    arrays["counts"] = np.array([found.counts[name] for name in COUNTS], dtype=np.int64)
    arrays["blocked"] = bytes_of(json.dumps(dict(sorted(found.log.totals().items()))))
    return arrays


def pose_arrays(scene: RestScene) -> Arrays:
    """Return the arrays of a rest pose's file: cloud, hull, candidate contacts."""
    return {
        "cloud": scene.cloud.astype("float32"), "points": scene.points.astype("float32"),
        "normals": scene.normals.astype("float32"),
        "hull": np.asarray(scene.grasp_target.hull.vertices), "centre": scene.grasp_target.centre,
        "mass": np.array(scene.grasp_target.mass), "quat_wxyz": np.array(scene.rest.quat_wxyz),
        "height": np.array(scene.rest.height), "probability": np.array(scene.rest.probability),
        "triples": np.array([scene.decided, len(scene.triples)]),
    }  # fmt: skip


def read_checked(path: Path, key: str | None = None, hashed: str | None = None) -> Arrays:
    """Read a file of a dataset and check it.

    Args:
        path: of the file.
        key: of the dataset that it must belong to; None for any.
        hashed: SHA-256 that it must have; None for any.

    Raises:
        InputError: as `read_shard`; for another hash, or numbers that are not finite.
    """
    arrays = read_shard(path, key)
    if hashed not in (None, file_hash(path)):
        raise InputError(f"{path} was changed after it was made: the command that made it makes it anew")
    for name, array in arrays.items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise InputError(f"{path} is damaged ({name} holds numbers that are not finite): remove it")
    return arrays


def read_manifest(folder: Path) -> Fields:
    """Read manifest.json.

    Raises:
        InputError: no dataset, damaged, or of another schema.
    """
    path = folder / MANIFEST
    again = "run `dexgrasp dataset generate` with the same settings again"
    missing = f"{folder} holds no dataset (no {path.name}): make one with `dexgrasp dataset generate`"
    manifest = read_json_object(path, again, missing, SCHEMA)
    try:
        read(_Manifest, manifest, more=True)
    except InputError as error:
        raise InputError(f"{path} is damaged ({error}): {again}") from None
    return manifest


def _files(value: Fields) -> None:
    """Refuse what names no files of a dataset: names must not leave its folder."""
    for name, hashed in value.items():
        TEXT.validate(hashed)
        if not re.fullmatch(r"(poses|grasps)/[^/\0]+-pose\d+[^/\0]*\.npz", name):
            raise ValueError


@dataclass(frozen=True)
class _Manifest:
    """Fields of a manifest that are read."""

    key: str
    cell: str
    settings: Fields
    objects: Fields
    complete: bool
    files: Annotated[Fields, Rule("hashes by names of files", _files)] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class PoseGrasps:
    """Grasps of an object in one rest pose.

    Attributes:
        name: of the object.
        pose: index of the rest pose.
        scene: arrays of the rest pose: `cloud`, `points`, `normals`, `hull`, `centre`, `mass` (see
            `pose_arrays`).
        grasps: arrays of `FIELDS`, n grasps each.
        counts: numbers of tries by stage, see `sampler.COUNTS`.
        blocked: reason -> number of infeasible postures.
    """

    name: str
    pose: int
    scene: Arrays
    grasps: Arrays
    counts: dict[str, int]
    blocked: dict[str, int]

    def __len__(self) -> int:
        """Return the number of grasps."""
        return len(self.grasps["q"])

    @property
    def coverage(self) -> float:
        """Share of the candidate points that are the nearest one to a contact of some grasp."""
        points = self.scene["points"]
        if not len(self):
            return 0.0
        from scipy.spatial import cKDTree

        _, nearest = cKDTree(points).query(self.grasps["contacts"].reshape(-1, 3))
        return len(np.unique(nearest)) / len(points)


def read_dataset(folder: str | Path) -> list[PoseGrasps]:
    """Read all rest poses of a complete dataset, in the order of their names.

    Raises:
        InputError: no dataset, not complete, files missing, cut off or changed.
    """
    folder = expand(folder)
    manifest = read_manifest(folder)
    if not (manifest["complete"] and manifest.get("files")):
        raise InputError(
            f"{folder} is not complete: run `dexgrasp dataset generate` with the same settings again"
        )
    files = {
        name: read_checked(folder / name, manifest["key"], hashed)
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
