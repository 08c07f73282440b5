"""A log of JSON lines from which a long script goes on."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any


class JsonLog:
    """Rows by their key, each in the file as soon as it is added; a last line that was cut off is dropped."""

    def __init__(self, path: Path, key: str) -> None:
        """Read what is there.

        Args:
            path: of the file; it and its folder are made where they are not there.
            key: the field that tells rows apart.
        """
        self._key = key
        self.rows: dict[Any, dict[str, Any]] = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("a+b")
        self._file.seek(0)
        content = self._file.read()
        whole = content.rfind(b"\n") + 1
        os.truncate(path, whole)
        for line in content[:whole].splitlines():
            row = json.loads(line)
            self.rows[row[key]] = row

    def add(self, row: Mapping[str, Any]) -> None:
        """Add a row, or replace that of the same key."""
        self.rows[row[self._key]] = dict(row)
        self._file.write(json.dumps(row).encode() + b"\n")
        self._file.flush()

    def __enter__(self) -> "JsonLog":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()
