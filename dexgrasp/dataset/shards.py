"""What the files of a dataset hold: shards, rest poses, and the manifest."""

import json
import re
from pathlib import Path

import numpy as np
import yaml

from dexgrasp.dataset.rest_scene import RestScene
from dexgrasp.dataset.sampler import COUNTS, Found
from dexgrasp.dataset.settings import SCHEMA
from dexgrasp.runs.shards import bytes_of, read_shard
from dexgrasp_env.arrays import Arrays, Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import file_hash, read_json_object

MANIFEST = "manifest.json"
_FILE_NAME = re.compile(r"(poses|grasps)/[^/\0]+-pose\d+[^/\0]*\.npz")

FIELDS: dict[str, Fields] = yaml.safe_load(Path(__file__).with_name("fields.yaml").read_text())
"""Field -> shape of one grasp, type, meaning, from fields.yaml."""


def fields_of(joints: int) -> dict[str, Fields]:
    """Return the fields, with their shapes for a robot with so many joints."""
    return {
        name: words | {"shape": [joints if size == "joints" else size for size in words["shape"]]}
        for name, words in FIELDS.items()
    }


def shard_arrays(found: Found, joints: int) -> Arrays:
    """Return the grasps of a shard, of a robot with so many joints, with their counts."""
    arrays: Arrays = {
        name: np.asarray(found.fields.get(name, []), dtype=words["type"]).reshape(len(found), *words["shape"])
        for name, words in fields_of(joints).items()
    }
    arrays["counts"] = np.array([found.counts[name] for name in COUNTS], dtype=np.int64)
    arrays["blocked"] = bytes_of(json.dumps(dict(sorted(found.log.totals().items()))))
    return arrays


def pose_arrays(scene: RestScene) -> Arrays:
    """Return a rest pose: cloud, hull, candidates."""
    return {
        "cloud": scene.cloud.astype("float32"), "points": scene.points.astype("float32"),
        "normals": scene.normals.astype("float32"),
        "hull": np.asarray(scene.grasp_target.hull.vertices), "centre": scene.grasp_target.centre,
        "mass": np.array(scene.grasp_target.mass), "quat_wxyz": np.array(scene.rest.quat_wxyz),
        "height": np.array(scene.rest.height), "probability": np.array(scene.rest.probability),
        "triples": np.array([scene.decided, len(scene.triples)]),
    }  # fmt: skip


def read_arrays(path: Path, key: str | None = None, hashed: str | None = None) -> Arrays:
    """Read a file of a dataset whole.

    Args:
        path: of the file.
        key: of the dataset that it must be of; None for any.
        hashed: SHA-256 that it must have; None for any.

    Raises:
        InputError: as `read_shard`, and where numbers are not finite.
    """
    arrays = read_shard(path, key)
    if hashed not in (None, file_hash(path)):
        raise InputError(f"{path} was changed after it was made: the command that made it makes it anew")
    for name, array in arrays.items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise InputError(f"{path} is damaged ({name} holds numbers that are not finite): remove it")
    return arrays


def complete(path: Path, key: str, hashed: str | None = None) -> bool:
    """Whether a file is there, whole, of this dataset, and, where its hash is known, as it was made."""
    try:
        return bool(read_arrays(path, key, hashed))
    except InputError:
        return False


def read_manifest(folder: Path) -> Fields:
    """Read manifest.json.

    Raises:
        InputError: no dataset, damaged, or of another schema.
    """
    path = folder / MANIFEST
    again = "run `dexgrasp dataset generate` with the same settings again"
    missing = f"{folder} holds no dataset (no {path.name}): make one with `dexgrasp dataset generate`"
    manifest = read_json_object(path, again, missing)
    if manifest.get("schema") != SCHEMA:
        raise InputError(f"{path} has schema {manifest.get('schema')}: valid is {SCHEMA}")
    if fault := _manifest_fault(manifest):
        raise InputError(f"{path} is damaged ({fault}): {again}")
    return manifest


def _manifest_fault(manifest: Fields) -> str | None:
    """Return what is wrong with a manifest; its files lie in its folder, whatever it says."""
    kinds = {"key": str, "settings": dict, "objects": dict, "complete": bool}
    for name, kind in kinds.items():
        if not isinstance(manifest.get(name), kind):
            return f"no {name}"
    files = manifest.get("files", {})
    if not isinstance(files, dict) or (manifest["complete"] and not files):
        return "no files"
    for name, hashed in files.items():
        if not _FILE_NAME.fullmatch(name) or not isinstance(hashed, str):
            return f"files has {name[:60]!r}"
    return None
