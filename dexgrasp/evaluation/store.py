"""Folder of an evaluation: one line a trial, written as it ends, so that a killed run loses nothing finished.

`run.json` has the identity of the evaluation, `trials.jsonl` its rows, `grasps/` the grasps of agents that certify
theirs, `summary.json` the summary. This module defines the schema of a row, and the names of a trial's files.
"""

import hashlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from dexgrasp.runs.folder import RunFolder
from dexgrasp.runs.lines import Lines, read_lines
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import read_json_object, readable, write_json
from dexgrasp_env.valid import Natural, Rule, number, read

Key = tuple[str, str, str, int]
"""Protocol, agent, object, trial."""
Trials = Sequence[Fields]
"""Rows of trials.jsonl."""
SERVER_GONE = "server_gone"
"""Reason of a trial without its policy server: it says nothing of the policy, so the next run repeats it."""

_RUN, _TRIALS = "run.json", "trials.jsonl"
_Seed = Annotated[int, number(ge=0, lt=2**32, whole=True)]


@dataclass
class Outcome:
    """Outcome of a trial.

    Attributes:
        success: held at height by the hand alone for 3 s.
        stable: little motion in the hand at the end.
        reason: code of the failure; None for successes.
        stage: last stage that the object reached, such as `lifted`.
        steps: control steps taken.
        total_reward: sum of the rewards of these, undiscounted.
        height: of the object's lowest point at the end, m.
        slip: in the hand since it left the table, m.
        tilt: in the hand since it left the table, rad.
        clean: a success that moved no neighbour by more than 2 cm; None where there are none.
        moved: largest displacement of a neighbour's centre that the robot caused, m.
        hit: number of neighbours that the robot touched.
        hit_names: their names.
        planning_seconds: as the agent reports; None if it does not plan.
        seconds: wall time of the trial.
        warnings: of the physics engine.
        details: of the agent's report.
        error: traceback of an agent's exception, or the fault of its action.
    """

    success: bool = False
    stable: bool = False
    reason: str | None = None
    stage: str = "untouched"
    steps: int = 0
    total_reward: float | None = 0.0
    height: float | None = 0.0
    slip: float | None = 0.0
    tilt: float | None = 0.0
    clean: bool | None = None
    moved: float | None = None
    hit: int | None = None
    hit_names: list[str] = field(default_factory=list)
    planning_seconds: float | None = None
    seconds: float = 0.0
    warnings: list[str] = field(default_factory=list)
    details: Fields = field(default_factory=dict)
    error: str | None = None


def _are_numbers(values: Iterable[Any]) -> None:
    for value in values:
        if value is not None:
            number().validate(value)


def _certificate(value: Any) -> None:
    _are_numbers(value.get("distances_cm") or ())
    units = ("_percent", "_margin", "_m", "_rad", "_fraction")
    _are_numbers(each for name, each in value.items() if name.endswith(units))


_Stages = Annotated[Fields | None, Rule("numbers by stage", lambda value: _are_numbers(value.values()))]


@dataclass(frozen=True)
class _Details:
    """Fields of an agent's report that summaries read; others are not checked."""

    stage_seconds: _Stages = None
    stage_repeats: _Stages = None
    certificate: Annotated[Fields | None, Rule("an object of numbers", _certificate)] = None


@dataclass(kw_only=True)
class _Row(Outcome):
    """Schema of a row: the outcome and what identifies the trial."""

    protocol: str
    agent: str
    object: str
    trial: Natural
    scene_seed: _Seed
    agent_seed: _Seed
    success: bool = field()
    stable: bool = field()
    reason: str | None = field()
    planning_seconds: float | None = field()
    details: _Details = field()  # type: ignore[assignment]
    env: Fields = field(default_factory=dict)
    grasp: str = ""


def row_fault(row: object) -> str | None:
    """Return the fault of a parsed line as a row, or None; further keys are allowed."""
    try:
        read(_Row, row, more=True)
    except InputError as error:
        return str(error)
    return None


def failed_or_disturbed(row: Fields) -> bool:
    """Return True for a trial that failed, or that succeeded but moved a neighbour."""
    return not row["success"] or row.get("clean") is False


def row_key(row: Fields) -> Key:
    """Return the key of a trial within its evaluation."""
    return row["protocol"], row["agent"], row["object"], row["trial"]


def trial_name(row: Fields) -> str:
    """Return the stem of a trial's files: protocol, agent, object and number, safe for any file system."""
    whole = "-".join(map(str, row_key(row)))
    plain = re.sub(r"[^\w.@+-]", ".", whole)
    if plain == whole and len(plain) <= 120:
        return plain
    return f"{plain[-100:]}-{hashlib.sha256(whole.encode(errors='replace')).hexdigest()[:6]}"


class TrialStore:
    """Finished trials of an evaluation; refuses a second process on the same folder."""

    def __init__(self, folder: Path, identity: Fields, **beside: str | None) -> None:
        """Open or make the folder; `beside` is added to the run.json of a new one.

        Raises:
            InputError: if the folder holds another evaluation or a damaged one, or cannot be written, or is being
                written to.
        """
        self.folder = folder
        self._lock = _run_folder(folder).claim(identity, **beside)
        try:
            self._lines = Lines(folder / _TRIALS, "trial", row_fault)
        except BaseException:
            self._lock.close()
            raise
        self._rows = _once_each(self._lines.rows)

    @property
    def rows(self) -> list[Fields]:
        """Trials, each once."""
        return list(self._rows.values())

    @property
    def finished(self) -> set[Key]:
        """Keys of the trials, except those without their policy server, which are repeated."""
        return {key for key, row in self._rows.items() if not _met_no_server(row)}

    def append(self, row: Fields, grasp: Fields | None = None) -> None:
        """Add a finished trial and its grasp; both are in their files when this returns."""
        if grasp is not None:
            row["grasp"] = f"grasps/{trial_name(row)}.json"
            write_json(self.folder / row["grasp"], grasp)
        self._lines.append(row)
        _keep(row, self._rows)

    def close(self) -> None:
        """Release the folder."""
        self._lines.close()
        self._lock.close()


def check_folder(folder: Path, identity: Fields) -> None:
    """Refuse a folder that holds another evaluation, without changing it.

    Raises:
        InputError: naming the differences.
    """
    _run_folder(folder).check(identity)


def read_rows(folder: Path) -> list[Fields]:
    """Read the finished trials of a folder without changing it, each once.

    Raises:
        InputError: if it holds no evaluation, or a damaged one.
    """
    path = folder / _TRIALS
    if not path.is_file():
        raise InputError(
            f"{folder} holds no evaluation (no {_TRIALS}): name the --out of `dexgrasp evaluate`"
        )
    with readable(path):
        return list(_once_each(read_lines(path, "trial", row_fault)).values())


def kept_grasps(folder: Path) -> list[Path]:
    """Return the grasp files of a folder's trials by name, those of failed or disturbed trials first.

    Raises:
        InputError: if there are none, or no evaluation.
    """
    short = {row.get("grasp") for row in read_rows(folder) if failed_or_disturbed(row)}
    found = sorted(
        (folder / "grasps").glob("*.json"), key=lambda file: (f"grasps/{file.name}" not in short, file.name)
    )
    if not found:
        raise InputError(
            f"{folder} holds no grasps: name the --out of `dexgrasp evaluate` with an agent that plans"
        )
    return found


def read_run(folder: Path) -> Fields:
    """Read the run.json of a folder.

    Raises:
        InputError: if it is missing or damaged.
    """
    return read_json_object(folder / _RUN, "choose another --out")


def _run_folder(folder: Path) -> RunFolder:
    return RunFolder(folder, _RUN, "evaluation", pieces=_TRIALS)


def _once_each(rows: Iterable[Fields]) -> dict[Key, Fields]:
    found = dict[Key, Fields]()
    for row in rows:
        _keep(row, found)
    return found


def _keep(row: Fields, found: dict[Key, Fields]) -> None:
    """Add a row unless its trial is there: the first counts, or the first that had its policy server."""
    key = row_key(row)
    if key not in found or _met_no_server(found[key]):
        found[key] = row


def _met_no_server(row: Fields) -> bool:
    return bool(row["reason"] == SERVER_GONE)
