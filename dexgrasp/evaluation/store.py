"""The folder of an evaluation: one line a trial, written as it ends; survives being killed.

`run.json` says what the trials are of, `trials.jsonl` holds them, `grasps/` the grasps of agents that certify theirs,
`summary.json` what comes out.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from dexgrasp.evaluation.rows import row_fault, trial_name
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import lock, parse_json, read_json_object, write_atomically

Key = tuple[str, str, str, int]  # protocol, agent, object, trial


class TrialStore:
    """Finished trials of one evaluation; a second process on the same folder is refused."""

    def __init__(self, folder: Path, identity: Mapping[str, Any]) -> None:
        """Open or make the folder.

        Raises:
            InputError: if the folder holds another evaluation or a damaged one, or cannot be written, or is being
                written to.
        """
        self.folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = (folder / "trials.jsonl").open("ab+")
            lock(
                self._file, f"another evaluation is writing to {folder}: wait for it, or choose another --out"
            )
            self._file.seek(0)
            content = self._file.read()
            _check_identity(folder / "run.json", identity, has_trials=b"\n" in content)
            pairs = list(_whole_lines(content, folder))
            # Cut off what a killed writer left unfinished.
            self._file.truncate(pairs[-1][1] if pairs else 0)
        except OSError as error:
            raise InputError(f"cannot write to {folder}: {error.strerror or error}") from None
        self.rows = _once_each(row for row, _ in pairs)

    @property
    def finished(self) -> set[Key]:
        """The trials that are there."""
        return {row_key(row) for row in self.rows}

    def append(self, row: dict[str, Any], grasp: Mapping[str, Any] | None = None) -> None:
        """Add a finished trial and its grasp; both are in their files when this returns."""
        if grasp is not None:
            row["grasp"] = f"grasps/{trial_name(row)}.json"
            self.write_json(row["grasp"], grasp)
        self._file.write((json.dumps(row, allow_nan=False) + "\n").encode())
        self._file.flush()
        self.rows.append(row)

    def write_json(self, name: str, content: Mapping[str, Any]) -> None:
        """Write a file of the folder as a whole."""
        write_atomically(self.folder / name, (json.dumps(content, indent=2, allow_nan=False) + "\n").encode())

    def close(self) -> None:
        """Let go of the folder."""
        self._file.close()


def check_folder(folder: Path, identity: Mapping[str, Any]) -> None:
    """Refuse a folder that holds another evaluation, without touching it: before anything that takes time.

    Raises:
        InputError: naming what is different.
    """
    if (folder / "run.json").is_file():
        _check_identity(folder / "run.json", identity, has_trials=True)


def row_key(row: Mapping[str, Any]) -> Key:
    """Return what tells a trial from the others of its evaluation."""
    return row.get("protocol") or "", row["agent"], row["object"], row["trial"]


def read_rows(folder: Path) -> list[dict[str, Any]]:
    """Read the finished trials of a folder without touching it, each once.

    Raises:
        InputError: if it holds no evaluation, or a damaged one.
    """
    path = folder / "trials.jsonl"
    try:
        content = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
        raise InputError(
            f"{folder} holds no evaluation (no trials.jsonl): name the --out of `dexgrasp evaluate`"
        ) from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    return _once_each(row for row, _ in _whole_lines(content, folder))


def read_run(folder: Path) -> dict[str, Any]:
    """Read what the trials of a folder are of.

    Raises:
        InputError: if there is no run.json, or it is not one.
    """
    return read_json_object(folder / "run.json", "choose another --out")


def _once_each(rows: Iterator[dict[str, Any]]) -> list[dict[str, Any]]:
    """Copies of a line, as merged files have them, count once: the first."""
    found: dict[Key, dict[str, Any]] = {}
    for row in rows:
        found.setdefault(row_key(row), row)
    return list(found.values())


def _check_identity(path: Path, identity: Mapping[str, Any], *, has_trials: bool) -> None:
    if not path.exists():
        if has_trials:
            raise InputError(
                f"{path.parent} holds trials, but no run.json says of what: choose another --out"
            )
        write_atomically(path, (json.dumps(identity, indent=2) + "\n").encode())
        return
    before = read_json_object(path, "choose another --out")
    changed = [key for key in identity if before.get(key) != json.loads(json.dumps(identity[key]))]
    if changed:
        was = "; ".join(f"{key} was {_short(before.get(key))}, is {_short(identity[key])}" for key in changed)
        raise InputError(f"{path.parent} holds another evaluation ({was}): choose another --out")


def _short(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 120 else text[:117] + "..."


def _whole_lines(data: bytes, folder: Path) -> Iterator[tuple[dict[str, Any], int]]:
    """Yield the rows with the offset of their ends; a last line without its newline is not there."""
    end = 0
    for number, line in enumerate(data.split(b"\n")[:-1], start=1):
        end += len(line) + 1
        where = f"{folder / 'trials.jsonl'} line {number}"
        try:
            row = parse_json(line)
        except ValueError:
            raise InputError(f"{where} is not JSON: remove it or choose another --out") from None
        fault = row_fault(row)
        if fault:
            raise InputError(f"{where} is no trial ({fault}): remove it or choose another --out")
        yield row, end
