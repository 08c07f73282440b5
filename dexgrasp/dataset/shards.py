"""What the files of a dataset hold: shards, rest poses, and the manifest."""

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.dataset.rest_scene import RestScene
from dexgrasp.dataset.sampler import COUNTS, Found
from dexgrasp.dataset.settings import SCHEMA
from dexgrasp.runs.shards import Arrays, bytes_of, read_shard
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import Layout, fits, read_json_object

MANIFEST = "manifest.json"
_FILE_NAME = re.compile(r"(poses|grasps)/[^/\0]+-pose\d+[^/\0]*\.npz")

FIELDS: dict[str, tuple[tuple[int, ...], str, str]] = {
    "q": ((23,), "float32", "rad, joints of arm and hand, at the placement"),
    "placement": ((3,), "float32", "x m, y m, yaw rad of the rest frame in the world frame"),
    "triple": ((3,), "int16", "candidate points it started from, thumb, index, middle"),
    "contacts": ((3, 3), "float32", "m, rest frame, thumb, index, middle"),
    "normals": ((3, 3), "float32", "unit, out of the object, rest frame"),
    "forces": ((3, 3), "float32", "N on the object that hold it, rest frame"),
    "palm_position": ((3,), "float32", "m, rest frame"),
    "palm_quat_wxyz": ((4,), "float32", "palm in the rest frame"),
    "margin": ((), "float32", "closure margin, exact cones"),
    "distances": ((3,), "float32", "m, signed distance of the compliant tips"),
    "clearance": ((), "float32", "m, least of hand and arm to all but touching tips, at most 0.02"),
    "joint_margin": ((), "float32", "rad to the nearest joint limit"),
    "load": ((), "int8", "firmest of planner.loads that it holds, -1: none"),
    "torque_fraction": ((), "float32", "largest joint torque of the forces over its limit"),
}
"""Field -> shape of one grasp, type, meaning."""


def shard_arrays(found: Found) -> Arrays:
    """Return the grasps of a shard with their counts."""
    arrays: Arrays = {
        name: np.asarray(found.fields.get(name, []), dtype=kind).reshape(len(found), *shape)
        for name, (shape, kind, _) in FIELDS.items()
    }
    arrays["counts"] = np.array([found.counts[name] for name in COUNTS], dtype=np.int64)
    arrays["blocked"] = bytes_of(json.dumps(dict(sorted(found.blocked.items()))))
    return arrays


def pose_arrays(scene: RestScene) -> Arrays:
    """Return a rest pose: cloud, hull, candidates."""
    return {
        "cloud": scene.cloud.astype("float32"), "points": scene.points.astype("float32"),
        "normals": scene.normals.astype("float32"),
        "hull": np.asarray(scene.grasp_target.hull.vertices), "centre": scene.grasp_target.centre,
        "mass": np.array(scene.grasp_target.mass), "quat_wxyz": scene.quat_wxyz, "height": np.array(scene.height),
        "probability": np.array(scene.probability), "triples": np.array([scene.decided, len(scene.triples)]),
    }  # fmt: skip


def read_arrays(path: Path, key: str | None = None) -> Arrays:
    """Read a file of a dataset whole.

    Raises:
        InputError: as `read_shard`, and where numbers are not finite or arrays are others.
    """
    arrays = read_shard(path, key)
    if fault := _fault(arrays):
        raise InputError(f"{path} is damaged ({fault}): the command that made it makes it anew")
    return arrays


def _fault(arrays: Arrays) -> str:
    """Return what is wrong with the arrays of a shard or of a rest pose; empty if nothing is."""
    for name, array in arrays.items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            return f"{name} holds numbers that are not finite"
    layout = _POSE if "cloud" in arrays else _SHARD
    lengths = {len(arrays[name]) for name in FIELDS if name in arrays and arrays[name].ndim}
    return "" if fits(arrays, layout) and len(lengths) < 2 else "not the arrays of a dataset"


_POSE: Layout = {
    "cloud": (None, 6), "points": (None, 3), "normals": (None, 3), "hull": (None, 3), "centre": (3,), "mass": (),
    "quat_wxyz": (4,), "height": (), "probability": (), "triples": (2,), "key": (None,),
}  # fmt: skip
_SHARD: Layout = {name: (None, *shape) for name, (shape, _, _) in FIELDS.items()} | {
    "counts": (len(COUNTS),), "blocked": (None,), "key": (None,),
}  # fmt: skip


def complete(path: Path, key: str, hashed: str | None = None) -> bool:
    """Whether a file is there, whole, of this dataset, and, where its hash is known, as it was made."""
    try:
        read_arrays(path, key)
        return hashed is None or file_hash(path) == hashed
    except InputError:
        return False


def read_manifest(folder: Path) -> dict[str, Any]:
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


def _manifest_fault(manifest: dict[str, Any]) -> str | None:
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


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file, 64 digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
