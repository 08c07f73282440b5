"""The folder of an evaluation: one line a trial, written as it ends; survives being killed.

`run.json` says what the trials are of, `trials.jsonl` holds them, `grasps/` the grasps of agents that certify theirs,
`summary.json` what comes out. What a line must hold to be counted is said here, and what a trial's files are called.
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
"""Lines of trials.jsonl."""
SERVER_GONE = "server_gone"
"""Reason of a trial whose policy server was not there: not a trial of the policy, so the next run makes it again."""

_RUN, _TRIALS = "run.json", "trials.jsonl"
_Seed = Annotated[int, number(ge=0, lt=2**32, whole=True)]


@dataclass
class Outcome:
    """Outcome of a trial.

    Attributes:
        success: held at height by the hand alone for 3 s.
        stable: little motion in the hand at the end.
        reason: why it failed, one of a countable few; None for successes.
        stage: how far the object came.
        steps: control steps taken.
        total_reward: sum of the rewards of these, undiscounted.
        height: of the object's lowest point at the end, m.
        slip: in the hand since it left the table, m.
        tilt: in the hand since it left the table, rad.
        clean: a success that moved no neighbour by more than 2 cm; None where there are none.
        moved: the farthest that a neighbour's centre has been from where it would be without the robot, m.
        hit: neighbours that the robot has touched.
        hit_names: theirs.
        planning_seconds: as the agent reports; None if it does not plan.
        seconds: wall time of the trial.
        warnings: of the physics engine.
        details: of the agent's report.
        error: the traceback of an agent's exception, or what was wrong with its action.
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
    """Fields of an agent's report that summaries read; the rest is the agent's own."""

    stage_seconds: _Stages = None
    stage_repeats: _Stages = None
    certificate: Annotated[Fields | None, Rule("an object of numbers", _certificate)] = None


@dataclass(kw_only=True)
class _Row(Outcome):
    """Required keys beside an outcome."""

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
    """Return what is wrong with a line as it was parsed, or None; other keys than these are left alone."""
    try:
        read(_Row, row, more=True)
    except InputError as error:
        return str(error)
    return None


def failed_or_disturbed(row: Fields) -> bool:
    """Return True for a trial that failed, or lifted the object and moved its neighbours."""
    return not row["success"] or row.get("clean") is False


def row_key(row: Fields) -> Key:
    """Return what tells a trial from the others of its evaluation."""
    return row["protocol"], row["agent"], row["object"], row["trial"]


def trial_name(row: Fields) -> str:
    """Return the stem of the files of a trial: its protocol, agent, object and number, as any file system takes it."""
    whole = "-".join(map(str, row_key(row)))
    plain = re.sub(r"[^\w.@+-]", ".", whole)
    if plain == whole and len(plain) <= 120:
        return plain
    return f"{plain[-100:]}-{hashlib.sha256(whole.encode(errors='replace')).hexdigest()[:6]}"


class TrialStore:
    """Finished trials of one evaluation; a second process on the same folder is refused."""

    def __init__(self, folder: Path, identity: Fields, **beside: str | None) -> None:
        """Open or make the folder; a new one's run.json holds `beside` as well.

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
        self.rows = _once_each(self._lines.rows)
        self._again = self.kept - self.finished

    @property
    def finished(self) -> set[Key]:
        """The trials that are there, but for those that met no policy server: these are run again."""
        return {row_key(row) for row in self.rows if not _met_no_server(row)}

    @property
    def kept(self) -> set[Key]:
        """All trials that are there."""
        return {row_key(row) for row in self.rows}

    def append(self, row: Fields, grasp: Fields | None = None) -> None:
        """Add a finished trial and its grasp; both are in their files when this returns."""
        if grasp is not None:
            row["grasp"] = f"grasps/{trial_name(row)}.json"
            write_json(self.folder / row["grasp"], grasp)
        self._lines.append(row)
        if row_key(row) in self._again:
            self.rows = _once_each([*self.rows, row])
        else:
            self.rows.append(row)

    def close(self) -> None:
        """Release the folder."""
        self._lines.close()
        self._lock.close()


def check_folder(folder: Path, identity: Fields) -> None:
    """Refuse a folder that holds another evaluation, without touching it: before anything that takes time.

    Raises:
        InputError: naming what is different.
    """
    _run_folder(folder).check(identity)


def read_rows(folder: Path) -> list[Fields]:
    """Read the finished trials of a folder without touching it, each once.

    Raises:
        InputError: if it holds no evaluation, or a damaged one.
    """
    path = folder / _TRIALS
    if not path.is_file():
        raise InputError(
            f"{folder} holds no evaluation (no {_TRIALS}): name the --out of `dexgrasp evaluate`"
        )
    with readable(path):
        return _once_each(read_lines(path, "trial", row_fault))


def kept_grasps(folder: Path) -> list[Path]:
    """Return the grasp files of a folder's trials, first those of trials that fell short, each in order of their names.

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
    """Read what the trials of a folder are of.

    Raises:
        InputError: if there is no run.json, or it is not one.
    """
    return read_json_object(folder / _RUN, "choose another --out")


def _run_folder(folder: Path) -> RunFolder:
    return RunFolder(folder, _RUN, "evaluation", pieces=_TRIALS)


def _once_each(rows: Iterable[Fields]) -> list[Fields]:
    """Copies of a line, as merged files have them, count once: the first, or one after it that met its server."""
    found: dict[Key, Fields] = {}
    for row in rows:
        key = row_key(row)
        if key not in found or _met_no_server(found[key]):
            found[key] = row
    return list(found.values())


def _met_no_server(row: Fields) -> bool:
    return bool(row["reason"] == SERVER_GONE)
