"""Files of a dataset: shards and rest poses as npz without pickle, written whole or not at all, and the manifest."""

import hashlib
import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp.dataset.rest_scene import RestScene
from dexgrasp.dataset.sampler import COUNTS, Found
from dexgrasp.dataset.settings import SCHEMA
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import Layout, content_hash, fits, read_json_object, read_npz, write_atomically

_FILE_NAME = re.compile(r"(poses|grasps)/[^/\0]+-pose\d+[^/\0]*\.npz")

Arrays = dict[str, NDArray[Any]]
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


def shard_path(folder: Path, name: str, pose: int, chunk: int) -> Path:
    """Return where a shard lies."""
    return folder / "grasps" / f"{name}-pose{pose:02d}-{chunk:04d}.npz"


def pose_path(folder: Path, name: str, pose: int) -> Path:
    """Return where a rest pose lies."""
    return folder / "poses" / f"{name}-pose{pose:02d}.npz"


def write_shard(path: Path, found: Found, key: str) -> None:
    """Write the grasps of a shard with their counts; `key` names what they were made from."""
    n, arrays = len(found), {}
    for name, (shape, kind, _) in FIELDS.items():
        arrays[name] = np.asarray(found.fields.get(name, []), dtype=kind).reshape(n, *shape)
    arrays["counts"] = np.array([found.counts[name] for name in COUNTS], dtype=np.int64)
    arrays["blocked"] = _text(json.dumps(dict(sorted(found.blocked.items()))))
    arrays["key"] = _text(key)
    write_arrays(path, arrays)


def write_pose(path: Path, scene: RestScene, key: str) -> None:
    """Write a rest pose: cloud, hull, candidates."""
    write_arrays(path, {
        "cloud": scene.cloud.astype("float32"), "points": scene.points.astype("float32"),
        "normals": scene.normals.astype("float32"),
        "hull": np.asarray(scene.grasp_target.hull.vertices), "centre": scene.grasp_target.centre,
        "mass": np.array(scene.grasp_target.mass), "quat_wxyz": scene.quat_wxyz, "height": np.array(scene.height),
        "probability": np.array(scene.probability), "triples": np.array([scene.decided, len(scene.triples)]),
        "key": _text(key),
    })  # fmt: skip


def write_arrays(path: Path, arrays: Arrays) -> None:
    """Write arrays as npz, sealed with a hash of them all; the same arrays give the same bytes."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays, seal=_text(_seal(arrays)))  # type: ignore[arg-type]
    write_atomically(path, buffer.getvalue())


def read_arrays(path: Path, key: str | None = None) -> Arrays:
    """Read an npz file of a dataset whole.

    Raises:
        InputError: missing, cut off, damaged, changed, numbers that are not finite, or of another dataset (`key`).
    """
    try:
        arrays = read_npz(path)
        seal = arrays.pop("seal", None)  # 0.1.0 wrote none
        if seal is not None and text(seal) != _seal(arrays):
            raise ValueError("changed")
    except FileNotFoundError:
        raise InputError(
            f"{path} is missing: run `dexgrasp dataset generate` again, it makes what is not there"
        ) from None
    except (OSError, ValueError):
        raise InputError(
            f"{path} is cut off or damaged: run `dexgrasp dataset generate` with the same settings again, "
            "it makes it anew"
        ) from None
    fault = _fault(arrays)
    if fault:
        raise InputError(
            f"{path} is damaged ({fault}): run `dexgrasp dataset generate` again, it makes it anew"
        )
    if key is not None and arrays["key"].tobytes() != key.encode():
        raise InputError(f"{path} belongs to another dataset: remove it, or use another folder")
    return arrays


def _seal(arrays: Arrays) -> str:
    return content_hash(*(part for name in sorted(arrays) for part in (name, arrays[name])))


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
    path = folder / "manifest.json"
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


def text(array: NDArray[Any]) -> str:
    """Read text kept as bytes."""
    return array.tobytes().decode()


def _text(value: str) -> NDArray[np.uint8]:
    return np.frombuffer(value.encode(), dtype=np.uint8)
