"""Generation of a dataset: independent jobs, resumed where they were stopped."""

import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from dexgrasp.data.dataset.dataset import (
    MANIFEST,
    fields_of,
    pose_arrays,
    read_checked,
    read_manifest,
    shard_arrays,
)
from dexgrasp.data.dataset.rest_scene import model_of, rest_scene
from dexgrasp.data.dataset.sampler import sample_shard
from dexgrasp.data.dataset.settings import SCHEMA, DatasetSettings, versions
from dexgrasp.runs.folder import RunFolder
from dexgrasp.runs.pool import Backend
from dexgrasp.runs.progress import Show, silent
from dexgrasp.runs.shards import check_names, make_missing, write_shard
from dexgrasp_env.arrays import Fields
from dexgrasp_env.files import content_hash, expand, file_hash, write_json
from dexgrasp_env.objects.load import object_name
from dexgrasp_env.objects.rest_poses import rest_poses


@dataclass(frozen=True)
class Job:
    """Job that makes one file; shard -1 is the rest pose itself."""

    target: str
    pose: int
    shard: int

    @property
    def file(self) -> str:
        """Path of the file in the dataset's folder."""
        stem = f"{object_name(self.target)}-pose{self.pose:02d}"
        return f"poses/{stem}.npz" if self.shard < 0 else f"grasps/{stem}-{self.shard:04d}.npz"


def generate(
    settings: DatasetSettings, folder: str | Path, backend: Backend = Backend(), progress: Show = silent
) -> Fields:
    """Generate a dataset, or what is missing of it; the files do not depend on the backend or on interruptions.

    Args:
        settings: of the dataset.
        folder: of the dataset; one with a dataset of other settings is refused.
        backend: of the workers; the nodes of a cluster share `folder`.
        progress: called with the number of files done and in all.

    Returns:
        The manifest.

    Raises:
        InputError: other settings or another process in `folder`; no cluster.
    """
    identity, robot, folder = _identity(settings), settings.cell.robot, expand(folder)
    key = content_hash(json.dumps(identity, sort_keys=True))
    about = {"schema": SCHEMA, "key": key, **identity}
    with RunFolder(folder, MANIFEST, "dataset").claim(about, complete=False):
        hashes = read_manifest(folder).get("files", {})
        jobs = [
            Job(target, pose, shard)
            for target in settings.objects
            for pose in range(len(rest_poses(model_of(target, settings))))
            for shard in range(-1, settings.chunks)
        ]
        work = partial(make, settings=settings, folder=folder.resolve(), key=key)
        make_missing(
            work,
            jobs,
            lambda job: read_checked(folder / job.file, key, hashes.get(job.file)),
            backend,
            progress,
        )
        manifest = about | {
            "complete": True,
            "frames": "rest: origin on the table under the centre of mass, z up; placement: its place in the world",
            "units": "m, rad, N, kg; quaternions wxyz", "fingers": list(robot.hand.grasp),
            "hand": robot.hand.stamp, "fields": fields_of(robot),
            "files": {job.file: file_hash(folder / job.file) for job in jobs},
        }  # fmt: skip
        write_json(folder / MANIFEST, manifest)
    return manifest


def make(job: Job, settings: DatasetSettings, folder: Path, key: str) -> None:
    """Make one file; an interrupted one leaves none."""
    if job.shard < 0:
        arrays = pose_arrays(rest_scene(job.target, job.pose, settings))
    else:
        found = sample_shard(job.target, job.pose, job.shard, settings)
        arrays = shard_arrays(found, settings.cell.robot)
    write_shard(folder / job.file, arrays, key)


def _identity(settings: DatasetSettings) -> Fields:
    """Return the identity of a dataset: all that its grasps depend on, as JSON."""
    check_names(settings.objects)
    objects = {}
    for target in settings.objects:
        model = model_of(target, settings)
        objects[object_name(target)] = {
            "content_hash": model.content_hash,
            "rest_poses": len(rest_poses(model)),
            "mass": model.mass,
        }
    return {
        "settings": settings.as_json(), "objects": objects, "cell": settings.cell.version, "versions": versions(),
    }  # fmt: skip
