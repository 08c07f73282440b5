"""Generation of demonstrations: jobs that can run anywhere in any order, and go on where they were stopped."""

import json
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dexgrasp.demos.rollout import Episode, Recorder
from dexgrasp.demos.settings import SCHEMA, DemoSettings
from dexgrasp.demos.shards import read_shard, write_shard
from dexgrasp.runs.folder import claim, occupy
from dexgrasp.runs.jobs import check_backend, run_jobs
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import content_hash, read_json_object, write_json
from dexgrasp_env.objects.load import object_name

FORMATS = ("minari", "lerobot")
ABOUT = "demos.json"
_PARTS = "parts"


@dataclass(frozen=True)
class Job:
    """Some scenes of one object: from trial `first` on."""

    target: str
    first: int


def generate(
    settings: DemoSettings, folder: Path, formats: tuple[str, ...] = ("minari",), workers: int = 1,
    backend: str = "loky", progress: Callable[[int, int], None] | None = None, *, address: str | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Make demonstrations, or what is missing of them; they do not depend on workers, backend or interruptions.

    Args:
        settings: what they are made of.
        folder: where; one that holds demonstrations of other settings is refused.
        formats: `minari` (in `data/`), `lerobot` (in `lerobot/`).
        workers: processes.
        backend: loky (processes), threading, or ray (a cluster whose nodes share `folder`).
        progress: called with files done and files in all.
        address: of the cluster, "auto" or host:port; None for a new one on this machine.

    Returns:
        What `demos.json` holds.

    Raises:
        InputError: other settings in `folder`, an unknown backend or format, two objects of one name.
    """
    check_backend(backend)
    _check(settings, formats)
    key = content_hash(json.dumps(settings.as_json(), sort_keys=True))
    with occupy(folder):
        old = read_about(folder) if (folder / ABOUT).exists() else None
        new = {"schema": SCHEMA, "settings": settings.as_json(), "formats": list(formats)}
        claim(folder, ABOUT, old, new, "set of demonstrations", {"complete": False})
        if old is not None and old.get("complete"):
            return old
        jobs = _jobs(settings)
        left = [job for job in jobs if read_shard(_path(folder, job), key) is None]
        if progress:
            progress(len(jobs) - len(left), len(jobs))
        work = run_jobs(make, left, (settings, folder.resolve(), key), workers, backend, address)
        for done, _ in enumerate(work, start=len(jobs) - len(left) + 1):
            if progress:
                progress(done, len(jobs))
        return _finish(settings, folder, formats, jobs, key, new)


def make(job: Job, settings: DemoSettings, folder: Path, key: str) -> None:
    """Make one file, whole or not at all."""
    recorder = Recorder(settings, job.target)
    episodes, failures = [], []
    for trial in range(job.first, min(job.first + settings.chunk, settings.episodes)):
        episode, failure = recorder.record(trial)
        if episode is None:
            failures.append(failure)
        else:
            episodes.append(episode)
    recorder.close()
    write_shard(_path(folder, job), episodes, failures, key)


def read_about(folder: Path) -> dict[str, Any]:
    """Read `demos.json`.

    Raises:
        InputError: if the folder holds no demonstrations, or the file is damaged or of another schema.
    """
    path = folder / ABOUT
    missing = f"{folder} holds no demonstrations (no {ABOUT}): make some with `dexgrasp demos generate`"
    about = read_json_object(path, "make them anew in another folder", missing)
    if about.get("schema") != SCHEMA or not isinstance(about.get("settings"), dict):
        raise InputError(f"{path} is damaged, or of another schema than {SCHEMA}")
    return about


def _jobs(settings: DemoSettings) -> list[Job]:
    return [
        Job(target, first)
        for target in settings.objects
        for first in range(0, settings.episodes, settings.chunk)
    ]


def _check(settings: DemoSettings, formats: tuple[str, ...]) -> None:
    for name in formats:
        if name not in FORMATS:
            raise InputError(f"format {name!r}: valid are {', '.join(FORMATS)}")
    names = Counter(object_name(target) for target in settings.objects)
    twice = [name for name, count in names.items() if count > 1]
    if twice:
        raise InputError(f"two objects are called {twice[0]!r}: rename one of the files")


def _path(folder: Path, job: Job) -> Path:
    return folder / _PARTS / f"{object_name(job.target)}-{job.first:05d}.npz"


def _finish(
    settings: DemoSettings,
    folder: Path,
    formats: tuple[str, ...],
    jobs: list[Job],
    key: str,
    about: dict[str, Any],
) -> dict[str, Any]:
    """Write the data sets anew from the parts, then what is said of them; the parts go last."""
    failures: Counter[str] = Counter()
    kept: Counter[str] = Counter()

    def episodes() -> Iterator[Episode]:
        failures.clear()
        kept.clear()
        for job in jobs:
            found = read_shard(_path(folder, job), key)
            if found is None:
                raise InputError(f"{_path(folder, job)} is gone or damaged: the same command makes it again")
            failures.update(found[1])
            for episode in found[0]:
                kept[episode.about["object"]] += 1
                yield episode

    for name in formats:
        if name == "minari":
            from dexgrasp.demos.minari_format import write_minari as write
        else:
            from dexgrasp.demos.lerobot_format import write_lerobot as write
        write(folder, settings, episodes())
    done = about | {
        "complete": True, "tried": len(settings.objects) * settings.episodes, "episodes": sum(kept.values()),
        "kept": dict(kept), "failures": dict(failures.most_common()),
    }  # fmt: skip
    write_json(folder / ABOUT, done)
    shutil.rmtree(folder / _PARTS)
    return done
