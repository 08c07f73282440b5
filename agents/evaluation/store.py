"""The folder of an evaluation: one line a trial, written as it ends; survives being killed."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TextIO

from dexgrasp_env.errors import InputError
from dexgrasp_env.files import write_atomically

Key = tuple[str, str, int]  # agent, object, trial


class TrialStore:
    """Finished trials of one evaluation; a second process on the same folder is refused."""

    def __init__(self, folder: Path, identity: Mapping[str, Any]) -> None:
        """Open or make the folder.

        Raises:
            InputError: if the folder holds another evaluation, or cannot be written, or is being written to.
        """
        self.folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = _lock((folder / "trials.jsonl").open("a+", encoding="utf-8"), folder)
            _check_identity(folder / "run.json", identity)
        except OSError as error:
            raise InputError(f"cannot write to {folder}: {error.strerror or error}") from None
        self.rows = _drop_partial_line(self._file, folder)

    @property
    def finished(self) -> set[Key]:
        """The trials that are there."""
        return {(row["agent"], row["object"], row["trial"]) for row in self.rows}

    def append(self, row: dict[str, Any]) -> None:
        """Add a finished trial; it is in the file when this returns."""
        self._file.write(json.dumps(row, allow_nan=False) + "\n")
        self._file.flush()
        self.rows.append(row)

    def write_json(self, name: str, content: Mapping[str, Any]) -> None:
        """Write a file of the folder as a whole."""
        write_atomically(self.folder / name, (json.dumps(content, indent=2, allow_nan=False) + "\n").encode())

    def close(self) -> None:
        """Let go of the folder."""
        self._file.close()


def read_rows(folder: Path) -> list[dict[str, Any]]:
    """Read the finished trials of a folder without touching it.

    Raises:
        InputError: if it holds no evaluation.
    """
    path = folder / "trials.jsonl"
    if not path.is_file():
        raise InputError(
            f"{folder} holds no evaluation (no trials.jsonl): name the --out of `dexgrasp evaluate`"
        )
    return [row for row, _ in _whole_lines(path.read_bytes(), folder)]


def _lock(file: TextIO, folder: Path) -> TextIO:
    try:
        import fcntl
    except ImportError:  # not a Unix: two writers are the user's to avoid
        return file
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        raise InputError(
            f"another evaluation is writing to {folder}: wait for it, or choose another --out"
        ) from None
    return file


def _check_identity(path: Path, identity: Mapping[str, Any]) -> None:
    if not path.exists():
        write_atomically(path, (json.dumps(identity, indent=2) + "\n").encode())
        return
    try:
        before = json.loads(path.read_text())
    except ValueError:
        raise InputError(f"{path} is not JSON: choose another --out") from None
    changed = [key for key in identity if before.get(key) != json.loads(json.dumps(identity[key]))]
    if changed:
        was = "; ".join(f"{key} was {_short(before.get(key))}, is {_short(identity[key])}" for key in changed)
        raise InputError(f"{path.parent} holds another evaluation ({was}): choose another --out")


def _short(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 120 else text[:117] + "..."


def _drop_partial_line(file: TextIO, folder: Path) -> list[dict[str, Any]]:
    """Cut off what a killed writer left unfinished and return the rows."""
    file.seek(0)
    pairs = list(_whole_lines(file.read().encode(), folder))
    file.truncate(pairs[-1][1] if pairs else 0)
    file.seek(0, 2)
    return [row for row, _ in pairs]


def _whole_lines(data: bytes, folder: Path) -> Iterator[tuple[dict[str, Any], int]]:
    """Yield the rows with the offset of their ends; a last line without its newline is not there."""
    end = 0
    for number, line in enumerate(data.splitlines(keepends=True), start=1):
        if not line.endswith(b"\n"):
            return
        end += len(line)
        try:
            yield json.loads(line), end
        except ValueError:
            raise InputError(
                f"{folder / 'trials.jsonl'} line {number} is not JSON: remove it or choose another --out"
            ) from None
