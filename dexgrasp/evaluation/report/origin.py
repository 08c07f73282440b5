"""Where figures come from: settings, versions, and the commands that make them again."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dexgrasp_env.errors import InputError
from dexgrasp_env.files import parse_json
from dexgrasp_env.objects.catalogue import OBJECT_SETS
from dexgrasp_env.objects.sets import is_set, set_targets
from dexgrasp_env.robot.cell import SIMULATED

_MOST_REPLAYS = 12


def describe_run(folder: Path) -> str:
    """Return one line on how an evaluation was made."""
    run = _run(folder)
    if run is None:
        return f"{folder.name}: settings unknown"
    versions = ", ".join(f"{name} {version}" for name, version in run.get("versions", {}).items())
    cell = f", in {run['cell']}" if _own_cell(run) else ""
    return f"{folder.name}: {_protocols(run)}, seed {run['seed']}, {run['trials']} trials a cell{cell}; {versions}"


def commands(folder: Path) -> list[str]:
    """Return the commands that make an evaluation again, as far as its settings are known."""
    run = _run(folder)
    if run is None or "agents" not in run or "objects" not in run:
        return [f"dexgrasp report {folder}"]
    words = ["dexgrasp evaluate --agents", *run["agents"], "--objects", *_sets(run["objects"])]
    words += ["--trials", run["trials"], "--seed", run["seed"], "--protocol", *_protocols(run).split("+")]
    for key, usual in (("mount", None), ("friction", None), ("mesh_mass", None), ("mesh_scale", 1.0)):
        if run.get(key) not in (None, usual):
            words += [f"--{key.replace('_', '-')}", run[key]]
    words += ["--cell CELL.yaml"] if _own_cell(run) else []
    return [" ".join([*map(str, words), "--out", str(folder)]), f"dexgrasp report {folder}"]


def replay_commands(folder: Path, rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the commands that show the first failures of an evaluation again."""
    failed = [row for row in rows if not row["success"]][:_MOST_REPLAYS]
    return [
        f"dexgrasp replay {folder} --agent {row['agent']} --object {row['object']} --trial {row['trial']} --video"
        for row in failed
    ]


def _run(folder: Path) -> dict[str, Any] | None:
    try:
        content = parse_json((folder / "run.json").read_bytes())
    except (OSError, ValueError):
        return None
    return content if isinstance(content, dict) and _is_of_an_evaluation(content) else None


def _own_cell(run: Mapping[str, Any]) -> bool:
    """Whether an evaluation was made in a cell of a user's."""
    return not str(run.get("cell", SIMULATED)).startswith(SIMULATED)


def _is_of_an_evaluation(run: Mapping[str, Any]) -> bool:
    """Whether settings have the types that an evaluation writes; those of others are unknown."""
    lists = (run.get("agents", []), run.get("objects", []), _protocol_names(run))
    return (
        {"seed", "trials"} <= run.keys()
        and isinstance(run.get("versions", {}), dict)
        and all(isinstance(names, list) and all(isinstance(name, str) for name in names) for names in lists)
    )


def _protocol_names(run: Mapping[str, Any]) -> Any:
    names = run.get("protocols") or run.get("protocol") or "?"
    return [names] if isinstance(names, str) else names


def _protocols(run: Mapping[str, Any]) -> str:
    return "+".join(_protocol_names(run))


def _sets(objects: Sequence[str]) -> list[str]:
    """The name of a set, or the path of a set file, where the objects are just its members."""
    name = next((name for name, members in OBJECT_SETS.items() if list(members) == list(objects)), None)
    if name is not None:
        return [name]
    path = objects[0].partition("#")[0] if objects else ""
    return [path] if is_set(path) and _members(path) == list(objects) else list(objects)


def _members(path: str) -> list[str]:
    try:
        return set_targets(path)
    except InputError:  # the file has gone or changed since
        return []
