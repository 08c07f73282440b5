"""Generation of a dataset: jobs that can run anywhere in any order, and go on where they were stopped."""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dexgrasp.dataset.rest_scene import model_of, rest_scene
from dexgrasp.dataset.sampler import REACH, sample_shard
from dexgrasp.dataset.settings import SCHEMA, DatasetSettings, versions
from dexgrasp.dataset.shards import (
    FIELDS,
    complete,
    file_hash,
    pose_path,
    read_manifest,
    shard_path,
    write_pose,
    write_shard,
)
from dexgrasp.planning.placement import NEIGHBOURS, SIDE_TOLERANCE
from dexgrasp.planning.proposals import LEAST_DISTANCE
from dexgrasp.runs.folder import claim
from dexgrasp.runs.jobs import check_backend, run_jobs
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import content_hash, parse_json, write_json
from dexgrasp_env.objects.load import object_name
from dexgrasp_env.objects.rest_poses import rest_poses
from dexgrasp_env.robot.active import active_cell


@dataclass(frozen=True)
class Job:
    """One shard; chunk -1 is the rest pose itself."""

    target: str
    pose: int
    chunk: int


def generate(
    settings: DatasetSettings, folder: Path, workers: int = 1, backend: str = "loky",
    progress: Callable[[int, int], None] | None = None, *, address: str | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Make a dataset, or what is missing of it; the files do not depend on workers, backend or interruptions.

    Args:
        settings: what it is made of.
        folder: where; one that holds a dataset of other settings is refused.
        workers: processes.
        backend: loky (processes), threading, or ray (a cluster whose nodes share `folder`).
        progress: called with files done and files in all.
        address: of the cluster, "auto" or host:port; None for a new one on this machine.

    Returns:
        The manifest.

    Raises:
        InputError: other settings in `folder`, an unknown backend, ray missing.
    """
    check_backend(backend)
    identity = _identity(settings)
    key = content_hash(json.dumps(identity, sort_keys=True))
    old = read_manifest(folder) if (folder / "manifest.json").exists() else None
    claim(
        folder,
        "manifest.json",
        old,
        {"schema": SCHEMA, **identity, "key": key},
        "dataset",
        {"complete": False},
    )
    hashes = (old or {}).get("files", {})
    jobs = [
        Job(target, pose, chunk)
        for target in settings.objects
        for pose in range(len(rest_poses(model_of(target, settings))))
        for chunk in range(-1, settings.chunks)
    ]
    left = [job for job in jobs if not complete(_path(folder, job), key, hashes.get(_name(folder, job)))]
    done, began = len(jobs) - len(left), time.perf_counter()
    if progress:
        progress(done, len(jobs))
    for _ in run_jobs(make, left, (settings, folder.resolve(), key), workers, backend, address):
        done += 1
        if progress:
            progress(done, len(jobs))
    return _finish(folder, identity, key, jobs, time.perf_counter() - began if left else 0.0)


def make(job: Job, settings: DatasetSettings, folder: Path, key: str) -> None:
    """Make one file, whole or not at all."""
    path = _path(folder, job)
    if job.chunk < 0:
        write_pose(path, rest_scene(job.target, job.pose, settings), key)
    else:
        write_shard(path, sample_shard(job.target, job.pose, job.chunk, settings), key)


def _path(folder: Path, job: Job) -> Path:
    name = object_name(job.target)
    return (
        pose_path(folder, name, job.pose) if job.chunk < 0 else shard_path(folder, name, job.pose, job.chunk)
    )


def _name(folder: Path, job: Job) -> str:
    return _path(folder, job).relative_to(folder).as_posix()


def _identity(settings: DatasetSettings) -> dict[str, Any]:
    """Return all that the grasps depend on."""
    objects = {}
    for target in settings.objects:
        model, name = model_of(target, settings), object_name(target)
        if name in objects:
            raise InputError(f"two objects are called {name!r}: rename one of the files")
        objects[name] = {
            "content_hash": model.content_hash,
            "rest_poses": len(rest_poses(model)),
            "mass": model.mass,
        }
    fixed = {
        "least_distance": LEAST_DISTANCE, "reach": [list(r) for r in REACH], "neighbours": NEIGHBOURS,
        "side_tolerance": SIDE_TOLERANCE,
    }  # fmt: skip
    return {
        "settings": settings.as_json(), "objects": objects, "fixed": fixed, "cell": active_cell().version,
        "versions": versions(),
    }  # fmt: skip


def _finish(
    folder: Path, identity: dict[str, Any], key: str, jobs: list[Job], seconds: float
) -> dict[str, Any]:
    """Write the manifest with the hash of every file, and the time, which is no part of the dataset, beside it."""
    files = {_name(folder, job): file_hash(_path(folder, job)) for job in jobs}
    manifest = {
        "schema": SCHEMA, "key": key, **identity, "complete": True,
        "frames": "rest: origin on the table under the centre of mass, z up; robot base for q and placement",
        "units": "m, rad, N, kg; quaternions wxyz", "fingers": ["thumb", "index", "middle"],
        "fields": {
            name: {"shape": list(shape), "type": kind, "meaning": says} for name, (shape, kind, says) in FIELDS.items()
        },
        "files": files,
    }  # fmt: skip
    write_json(folder / "manifest.json", manifest)
    if seconds:
        _log_time(folder, seconds)
    return manifest


def _log_time(folder: Path, seconds: float) -> None:
    path = folder / "seconds.json"
    try:
        before = list(parse_json(path.read_bytes())["last_run"])
    except (
        OSError,
        ValueError,
        LookupError,
        TypeError,
    ):  # the times are for people: what is damaged is dropped
        before = []
    write_json(path, {"last_run": [*before, round(seconds, 1)]})
