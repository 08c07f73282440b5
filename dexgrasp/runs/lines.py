"""A file of JSON lines, one a finished piece: what a killed writer left unfinished is not there."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import check_file, parse_json, read_file

Fault = Callable[[object], str | None]
"""Returns what is wrong with a line as it was parsed, None where nothing is."""


class Lines:
    """A file that lines are added to."""

    def __init__(self, path: Path, kind: str, fault: Fault) -> None:
        """Open or make it; a line is what `kind` says, for messages, where `fault` finds none.

        Raises:
            InputError: naming a line that is none, or that the file is too large.
        """
        self._file = path.open("ab+")
        check_file(path)
        self._file.seek(0)
        whole = list(_whole(self._file.read(), path, kind, fault))
        self._file.truncate(whole[-1][1] if whole else 0)
        self.rows = [row for row, _ in whole]

    def append(self, row: Fields) -> None:
        """Add a line; it is in the file when this returns."""
        self._file.write((json.dumps(row, allow_nan=False) + "\n").encode())
        self._file.flush()
        self.rows.append(row)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def read_lines(path: Path, kind: str, fault: Fault) -> list[Fields]:
    """Read the lines of a file, as `Lines` does, without touching it.

    Raises:
        OSError: if it cannot be read.
        InputError: naming a line that is none.
    """
    return [row for row, _ in _whole(read_file(path), path, kind, fault)]


def _whole(content: bytes, path: Path, kind: str, fault: Fault) -> Iterator[tuple[Fields, int]]:
    """Yield the lines with the offsets of their ends."""
    end = 0
    for number, line in enumerate(content.split(b"\n")[:-1], start=1):
        end += len(line) + 1
        where = f"{path} line {number}"
        try:
            row = parse_json(line)
        except ValueError:
            raise InputError(f"{where} is not JSON: remove it or choose another --out") from None
        if wrong := fault(row):
            raise InputError(f"{where} is no {kind} ({wrong}): remove it or choose another --out")
        yield row, end
