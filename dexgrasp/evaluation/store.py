"""The folder of an evaluation: one line a trial, written as it ends; survives being killed.

`run.json` says what the trials are of, `trials.jsonl` holds them, `grasps/` the grasps of agents that certify theirs,
`summary.json` what comes out.
"""

from collections.abc import Iterable
from pathlib import Path

from dexgrasp.evaluation.rows import Key, fell_short, row_fault, row_key, trial_name
from dexgrasp.runs.folder import RunFolder
from dexgrasp.runs.lines import Lines, read_lines
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import read_json_object, readable, write_json

_RUN, _TRIALS = "run.json", "trials.jsonl"


class TrialStore:
    """Finished trials of one evaluation; a second process on the same folder is refused."""

    def __init__(self, folder: Path, identity: Fields) -> None:
        """Open or make the folder.

        Raises:
            InputError: if the folder holds another evaluation or a damaged one, or cannot be written, or is being
                written to.
        """
        self.folder = folder
        self._lock = _run_folder(folder).claim(identity)
        try:
            self._lines = Lines(folder / _TRIALS, "trial", row_fault)
        except BaseException:
            self._lock.close()
            raise
        self.rows = _once_each(self._lines.rows)

    @property
    def finished(self) -> set[Key]:
        """The trials that are there."""
        return {row_key(row) for row in self.rows}

    def append(self, row: Fields, grasp: Fields | None = None) -> None:
        """Add a finished trial and its grasp; both are in their files when this returns."""
        if grasp is not None:
            row["grasp"] = f"grasps/{trial_name(row)}.json"
            write_json(self.folder / row["grasp"], grasp)
        self._lines.append(row)
        self.rows.append(row)

    def close(self) -> None:
        """Let go of the folder."""
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
        rows = read_lines(path, "trial", row_fault)
    return _once_each(rows)


def kept_grasps(folder: Path) -> list[Path]:
    """Return the grasp files of a folder's trials, first those of trials that fell short, each in order of their names.

    Raises:
        InputError: if there are none, or no evaluation.
    """
    short = {row.get("grasp") for row in read_rows(folder) if fell_short(row)}
    files = (folder / "grasps").glob("*.json")
    found = sorted(files, key=lambda file: (f"grasps/{file.name}" not in short, file.name))
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
    """Copies of a line, as merged files have them, count once: the first."""
    found: dict[Key, Fields] = {}
    for row in rows:
        found.setdefault(row_key(row), row)
    return list(found.values())
