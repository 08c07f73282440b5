"""The folder of a dataset or a training: claimed by what it is made of, and by one writer at a time."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

from dexgrasp_env.errors import InputError
from dexgrasp_env.files import lock, read_json_object, write_json

LOCK = ".lock"


def claim(
    folder: Path,
    name: str,
    old: Mapping[str, Any] | None,
    new: Mapping[str, Any],
    kind: str,
    beside: Mapping[str, Any] | None = None,
) -> None:
    """Write `new` into the file `name` of an empty or new folder, or check that it agrees with what is there.

    Args:
        folder: where.
        name: of the file that says what the folder is made of.
        old: what that file says, None where it is not there; of it only the keys of `new` count.
        new: what the folder is to be made of, as JSON can hold it.
        kind: "dataset" or "training", for messages.
        beside: what a new file holds more.

    Raises:
        InputError: other contents, a file in the way, a folder that holds something else.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file: --out must be a folder")
    if old is not None:
        changed = difference(old, json.loads(json.dumps(new)))
        if changed:
            raise InputError(f"{folder} holds a {kind} of other settings ({changed}): choose another --out")
    elif folder.is_dir() and any(path.name != LOCK for path in folder.iterdir()):
        raise InputError(f"{folder} is not empty and holds no {kind}: choose another --out")
    else:
        write_json(folder / name, {**new, **(beside or {})})


def claim_training(folder: Path, name: str, run: Mapping[str, Any]) -> None:
    """Claim a folder for a training; `name` is the file that says what is trained on what.

    Raises:
        InputError: another training, a damaged file, a folder that holds something else.
    """
    path = folder / name
    old = read_json_object(path, "choose another --out") if path.exists() else None
    claim(folder, name, old, run, "training")


def difference(old: Any, new: Any, name: str = "") -> str:
    """Return the first thing that differs, as "name: what there, what now"; empty where nothing does."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in new:
            if found := difference(old.get(key), new[key], str(key)):
                return found
        more = [key for key in old if key not in new] if name else []
        return f"{more[0]}: there, not now" if more else ""
    return "" if old == new else f"{name}: {str(old)[:60]} there, {str(new)[:60]} now"


def occupy(folder: Path) -> IO[bytes]:
    """Make the folder and lock it; the lock goes when the file returned is closed or the process ends.

    Raises:
        InputError: if another process holds it, or a file is in the way.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file: --out must be a folder")
    folder.mkdir(parents=True, exist_ok=True)
    file = (folder / LOCK).open("ab")
    lock(file, f"another process is writing to {folder}: wait for it, or choose another --out")
    return file
