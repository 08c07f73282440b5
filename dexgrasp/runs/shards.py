"""Finished pieces as files of arrays: npz without pickle, sealed with a hash, each written whole or not at all."""

import io
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from dexgrasp.runs.pool import Backend, run_pool
from dexgrasp_env.arrays import AnyArray, Arrays
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import content_hash, read_npz, write_atomically
from dexgrasp_env.objects.load import object_name

T = TypeVar("T")


def make_missing(
    work: Callable[[T], object], pieces: Sequence[T], read: Callable[[T], object], backend: Backend,
    show: Callable[[int, int], object],
) -> None:  # fmt: skip
    """Make every piece that is not there yet, in any order.

    Args:
        work: makes one, whole or not at all; see `run_pool`.
        pieces: all there are to be.
        read: one; raises an `InputError` where it is not finished.
        backend: where the work is done.
        show: called with pieces done and pieces in all.
    """
    left = list[T]()
    for piece in pieces:
        try:
            read(piece)
        except InputError:
            left.append(piece)
    there = len(pieces) - len(left)
    show(there, len(pieces))
    for done, _ in enumerate(run_pool(work, left, backend), start=there + 1):
        show(done, len(pieces))


def check_names(targets: Sequence[str]) -> None:
    """Refuse objects whose files would have the same names.

    Raises:
        InputError: naming one.
    """
    for name, count in Counter(map(object_name, targets)).items():
        if count > 1:
            raise InputError(f"two objects are called {name!r}: rename one of the files")


def write_shard(path: Path, arrays: Mapping[str, AnyArray], key: str) -> None:
    """Write arrays; the same arrays give the same bytes.

    Args:
        path: of the file.
        arrays: under names other than `key` and `seal`.
        key: names what they were made from.
    """
    kept = {**arrays, "key": bytes_of(key)}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **kept, seal=bytes_of(_seal(kept)))  # type: ignore[arg-type]
    write_atomically(path, buffer.getvalue())


def read_shard(path: Path, key: str | None = None) -> Arrays:
    """Read what `write_shard` wrote.

    Args:
        path: of the file.
        key: what it must be made from; None for anything.

    Raises:
        InputError: missing, cut off, damaged, changed, or made from something else.
    """
    try:
        arrays = read_npz(path)
        if text_of(arrays.pop("seal")) != _seal(arrays):
            raise ValueError("changed")
        made_from = text_of(arrays["key"])
    except FileNotFoundError:
        raise InputError(f"{path} is missing: the command that made the others makes it") from None
    except (OSError, ValueError, LookupError):
        raise InputError(f"{path} is cut off or damaged: the command that made it makes it anew") from None
    if key not in (None, made_from):
        raise InputError(f"{path} was made from other settings: remove it, or use another folder")
    return arrays


def bytes_of(text: str) -> NDArray[np.uint8]:
    """Return text as an array of its bytes."""
    return np.frombuffer(text.encode(), dtype=np.uint8)


def text_of(array: AnyArray) -> str:
    """Return the text that `bytes_of` was given."""
    return array.tobytes().decode()


def _seal(arrays: Arrays) -> str:
    return content_hash(*(part for name in sorted(arrays) for part in (name, arrays[name])))
