"""Watch over what code reads: weights, whatever they are called and wherever they are, and modules that it imports."""

import os
import sys
import sysconfig
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib.util import source_from_cache
from pathlib import Path
from typing import Any

import dexgrasp_env
from dexgrasp_env.files import cache_dir

_watches: list[set[Path]] = []


@contextmanager
def files_read(found: set[Path]) -> Iterator[None]:
    """Collect the user's files that are opened for reading within, and the modules that are imported, in `found`.

    Files of Python, of installed packages and of caches are nobody's own; what native code opens is not seen.
    """
    _begin_watching()
    _watches.append(found)
    try:
        yield
    finally:
        _watches[:] = [each for each in _watches if each is not found]  # equal ones may be nested
        found -= {path for path in found if not _is_own(path)}


@cache
def _begin_watching() -> None:
    sys.addaudithook(_note)  # for the life of the process


def _note(event: str, args: tuple[Any, ...]) -> None:
    if not _watches or event != "open" or not isinstance(args[0], str | bytes | os.PathLike):
        return
    path, flags, writes = os.fsdecode(args[0]), args[2], os.O_WRONLY | os.O_RDWR | os.O_CREAT
    if isinstance(flags, int) and flags & writes:
        return
    with suppress(ValueError, NotImplementedError):  # a module is its source, whichever form of it is read
        path = source_from_cache(path)
    for found in _watches:
        found.add(Path(path))


@cache
def _others() -> tuple[Path, ...]:
    """Return the folders of what is installed, or kept to save time."""
    system = "/proc", "/sys", "/dev", "/etc", "/usr/share", "/usr/lib"
    libraries = sysconfig.get_path("stdlib"), Path(__file__).parents[1], Path(dexgrasp_env.__file__).parent
    return tuple(Path(place).resolve() for place in (*libraries, *system, os.path.expanduser("~/.cache")))


def _is_own(path: Path) -> bool:
    with suppress(OSError, ValueError):
        path = path.resolve()
        installed = {"site-packages", "dist-packages"} & set(path.parts)
        return (
            path.is_file() and not installed and not any(map(path.is_relative_to, (*_others(), cache_dir())))
        )
    return False
