"""Generation of demonstrations: independent jobs, resumed where they were stopped."""

import shutil
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from dexgrasp.data.demonstrations.hdf5_formats import DATA, write_minari, write_robomimic
from dexgrasp.data.demonstrations.lerobot_format import write_lerobot
from dexgrasp.data.demonstrations.rollout import Demonstration, record
from dexgrasp.data.demonstrations.settings import SCHEMA, DemoSettings, Formats
from dexgrasp.runs.folder import RunFolder, replaced
from dexgrasp.runs.pool import Backend
from dexgrasp.runs.progress import Show, silent
from dexgrasp.runs.shards import check_names, make_missing
from dexgrasp.runs.weights import below, read_arrays, write_arrays
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import expand, read_json_object, write_json
from dexgrasp_env.objects.load import object_name
from dexgrasp_env.valid import checked

FORMATS = {
    "minari": (DATA, write_minari), "lerobot": ("lerobot", write_lerobot), "robomimic": ("robomimic", write_robomimic),
}  # fmt: skip
"""Format -> name of its folder, and function that writes it."""
ABOUT = "demos.json"
_PARTS = "parts"


@dataclass(frozen=True)
class Job:
    """Job that records some scenes of one object, from trial `first` on."""

    target: str
    first: int

    @property
    def file(self) -> str:
        """Path of its file in the folder of the demonstrations."""
        return f"{_PARTS}/{object_name(self.target)}-{self.first:05d}.safetensors"


@checked
def generate(
    settings: DemoSettings, folder: str | Path, formats: Formats = ("minari",), backend: Backend = Backend(),
    progress: Show = silent,
) -> Fields:  # fmt: skip
    """Record demonstrations, or those that are missing; they do not depend on the backend or on interruptions.

    Args:
        settings: of the demonstrations.
        folder: of the demonstrations; one with demonstrations of other settings is refused.
        formats: `minari` (in `data/`), `lerobot`, `robomimic` (in folders of their names).
        backend: of the workers; the nodes of a cluster share `folder`.
        progress: called with the number of files done and in all.

    Returns:
        The content of `demos.json`.

    Raises:
        InputError: other settings or another process in `folder`, an unknown format, two objects of one name, no
            cluster.
    """
    check_names(settings.objects)
    folder = expand(folder)
    about = {"schema": SCHEMA, "settings": settings.as_json(), "formats": list(formats)}
    with RunFolder(folder, ABOUT, "set of demonstrations").claim(about, complete=False):
        there = read_about(folder)
        if there.get("complete"):
            return there
        jobs = [
            Job(target, first)
            for target in settings.objects
            for first in range(0, settings.episodes, settings.chunk)
        ]
        work = partial(make, settings=settings, folder=folder.resolve())
        make_missing(work, jobs, lambda job: read_arrays(folder / job.file), backend, progress)
        about |= _converted(settings, folder, formats, [folder / job.file for job in jobs])
        write_json(folder / ABOUT, about)
        shutil.rmtree(folder / _PARTS)
    return about


def make(job: Job, settings: DemoSettings, folder: Path) -> None:
    """Make one file; an interrupted one leaves none."""
    last = min(job.first + settings.chunk, settings.episodes)
    outcomes = list(record(settings, job.target, range(job.first, last)))
    kept = [episode for episode, _ in outcomes if episode is not None]
    parts = {
        f"{i}/{name}": array for i, episode in enumerate(kept) for name, array in episode.arrays().items()
    }
    note = {"about": [episode.about for episode in kept], "failures": [why for _, why in outcomes if why]}
    write_arrays(folder / job.file, parts, note)


def read_about(folder: Path) -> Fields:
    """Read `demos.json`.

    Raises:
        InputError: if the folder holds no demonstrations, or the file is damaged or of another schema.
    """
    path = folder / ABOUT
    missing = f"{folder} holds no demonstrations (no {ABOUT}): make some with `dexgrasp demos generate`"
    about = read_json_object(path, "make them anew in another folder", missing, SCHEMA)
    if not isinstance(about.get("settings"), dict):
        raise InputError(f"{path} is damaged: it has no settings")
    return about


def _converted(settings: DemoSettings, folder: Path, formats: tuple[str, ...], parts: list[Path]) -> Fields:
    """Write the data sets from the parts; return their counts."""
    notes = [read_arrays(path)[1] for path in parts]
    kept = Counter(about["object"] for note in notes for about in note["about"])
    failures = Counter(reason for note in notes for reason in note["failures"])
    if not kept:
        counts = ", ".join(f"{reason} {count}" for reason, count in failures.most_common())
        raise InputError(f"not one demonstration succeeded: {counts}")
    for name in formats:
        place, write = FORMATS[name]
        with replaced(folder / place) as making:
            write(making, settings, _episodes(parts))
    return {
        "complete": True, "tried": len(settings.objects) * settings.episodes, "episodes": sum(kept.values()),
        "kept": dict(kept), "failures": dict(failures.most_common()),
    }  # fmt: skip


def _episodes(parts: Iterable[Path]) -> Iterator[Demonstration]:
    """Yield the demonstrations of files.

    Raises:
        InputError: missing or damaged.
    """
    for path in parts:
        arrays, note = read_arrays(path)
        for i, about in enumerate(note["about"]):
            yield Demonstration.of_arrays(below(arrays, f"{i}/"), about)
