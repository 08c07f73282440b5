"""Provenance of a report: settings, versions, and the commands that reproduce it."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dexgrasp.evaluation.store import read_run
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.catalogue import OBJECT_SETS
from dexgrasp_env.objects.sets import is_set, set_targets
from dexgrasp_env.robot.cell import SIMULATED
from dexgrasp_env.valid import read

_Names = tuple[str, ...]


@dataclass(frozen=True)
class _RunFile:
    """Content of run.json, as far as a report shows it."""

    seed: Any
    trials: Any
    agents: _Names = ()
    objects: _Names = ()
    protocol: str = "?"
    versions: Fields = field(default_factory=dict)
    cell: Any = SIMULATED
    robot: Any = None
    mount: Any = None
    friction: Any = None
    mesh_mass: Any = None
    mesh_scale: Any = 1.0


def _run(folder: Path) -> _RunFile | None:
    try:
        return read(_RunFile, read_run(folder), more=True)
    except InputError:
        return None


def describe_run(folder: Path) -> str:
    """Return the settings of an evaluation as one line."""
    run = _run(folder)
    if run is None:
        return f"{folder.name}: settings unknown"
    versions = ", ".join(f"{name} {version}" for name, version in run.versions.items())
    cell = "" if str(run.cell).startswith(SIMULATED) else f", in {run.cell}"
    return f"{folder.name}: {run.protocol}, seed {run.seed}, {run.trials} trials a cell{cell}; {versions}"


def commands(folder: Path) -> list[str]:
    """Return the commands that reproduce an evaluation, as far as its settings are known."""
    run = _run(folder)
    if run is None or not run.agents or not run.objects:
        return [_typed("report", folder)]
    words = ["evaluate", "--agents", *run.agents, "--objects", *_sets(list(run.objects))]
    words += ["--trials", run.trials, "--seed", run.seed, "--protocol", *run.protocol.split("+")]
    for name in ("mount", "friction", "mesh_mass", "mesh_scale"):
        value = getattr(run, name)
        if value not in (None, getattr(_RunFile, name)):
            words += [f"--{name.replace('_', '-')}", value]
    words += ["--robot", run.robot] if run.robot else []
    return [_typed(*words, "--out", folder), _typed("report", folder)]


def replay_commands(folder: Path, rows: Sequence[Fields]) -> list[str]:
    """Return the commands that replay the first failures of an evaluation."""
    failed = [row for row in rows if not row["success"]][:12]
    keys = ("agent", "object", "trial", "protocol")
    named = ([word for key in keys for word in (f"--{key}", row[key])] for row in failed)
    return [_typed("replay", folder, *words, "--video") for words in named]


def _typed(*words: object) -> str:
    """Return a command, quoted for a shell."""
    return shlex.join(["dexgrasp", *map(str, words)])


def _sets(objects: list[str]) -> list[str]:
    """Return the name of a set, or the path of a set file, where the objects are just its members."""
    for name, members in OBJECT_SETS.items():
        if list(members) == objects:
            return [name]
    path = objects[0].partition("#")[0]
    try:
        return [path] if is_set(path) and set_targets(path) == objects else objects
    except InputError:  # the file has gone or changed since
        return objects
