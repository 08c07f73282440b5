"""The folder of long work: one writer at a time, and a file that says what its finished pieces are of."""

import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError, shortened
from dexgrasp_env.files import lock, read_json_object, write_json


@dataclass(frozen=True)
class RunFolder:
    """Folder of resumable work: it goes on there after it was stopped.

    Attributes:
        path: of the folder.
        about: name of the file in it that says what the work is of.
        kind: of work, for messages.
        pieces: pattern of the files that belong to nobody where that file is missing.
    """

    path: Path
    about: str
    kind: str
    pieces: str = "*"

    def check(self, identity: Fields) -> None:
        """Refuse a folder that cannot be `identity`'s, without touching it: before anything that takes time.

        Args:
            identity: all that the pieces depend on, as JSON can hold it; other keys of the file do not count.

        Raises:
            InputError: naming what is different, or what is in the way.
        """
        if self.path.exists() and not self.path.is_dir():
            raise InputError(f"{self.path} is a file: --out must be a folder")
        file = self.path / self.about
        if file.exists():
            old = read_json_object(file, "choose another --out")
            if changed := "; ".join(_differences(old, json.loads(json.dumps(identity)))):
                raise InputError(
                    f"{self.path} holds another {self.kind}, of other settings ({changed}): choose another --out"
                )
        elif any(not path.name.startswith(".") for path in self.path.glob(self.pieces)):
            raise InputError(
                f"{self.path} is not empty and holds no {self.kind} (no {self.about}): choose another --out"
            )

    def claim(self, identity: Fields, **beside: Any) -> IO[bytes]:
        """Make the folder, lock it, and check or write what it is of.

        Args:
            identity: as for `check`.
            **beside: what a new file holds more.

        Returns:
            The lock: it goes when this file is closed, or the process ends.

        Raises:
            InputError: as `check`; where another process holds the folder, or it cannot be written to.
        """
        try:
            file = (make_folder(self.path) / ".lock").open("ab")
        except OSError as error:
            raise InputError(f"cannot write to {self.path}: {error.strerror or error}") from None
        try:
            lock(file, f"another process is writing to {self.path}: wait for it, or choose another --out")
            self.check(identity)
            about = self.path / self.about
            if not about.exists():
                write_json(about, identity | beside)
        except BaseException:
            file.close()
            raise
        return file


def _differences(old: Any, new: Any, name: str = "") -> Iterator[str]:
    """Yield what differs, as "name: what there, what now"; below the top, keys that are gone differ as well."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in [*new, *(old.keys() - new.keys() if name else ())]:
            yield from _differences(old.get(key), new.get(key), str(key))
    elif old != new:
        before, now = (value if isinstance(value, str) else json.dumps(value) for value in (old, new))
        yield f"{name}: {shortened(before, 120)} there, {shortened(now, 120)} now"


@contextmanager
def replaced(folder: Path) -> Iterator[Path]:
    """Yield a new folder to fill, which replaces `folder` once the block has ended."""
    making = folder.with_name(f"{folder.name}.part")
    shutil.rmtree(making, ignore_errors=True)
    yield making
    shutil.rmtree(folder, ignore_errors=True)
    making.rename(folder)


def make_folder(path: Path) -> Path:
    """Make a folder for results, before the work that fills it.

    Raises:
        InputError: if it cannot be made, or written to.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise InputError(f"{path} is a file: --out must be a folder") from None
    except OSError as error:
        raise InputError(f"cannot write to {path}: {error.strerror or error}") from None
    if not os.access(path, os.W_OK):
        raise InputError(f"cannot write to {path}: name a folder that can be written to")
    return path
