"""Files: the user's cache, content hashes, atomic writes, values as JSON holds them."""

import errno
import hashlib
import io
import json
import math
import os
import secrets
import stat
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import IO, Any, NoReturn

import numpy as np
import platformdirs

from dexgrasp_env.arrays import Arrays, Fields
from dexgrasp_env.errors import InputError

_MIB = 1 << 20
_LARGEST = {
    "": 128, ".yaml": 1, "ascii .ply": 24, ".json": 64, ".obj": 64, ".jsonl": 256, ".npz": 512, ".zip": 512,
    ".safetensors": 1024, ".las": 512, ".laz": 512, ".bag": 4096,
}  # fmt: skip
"""Kind, "" for all others -> MiB that are read of a file and of what it unpacks to: what becomes of them takes 2 GB
of memory at most."""
_HEADER = 1 << 16  # bytes that an npy file of version 1.0 can have in front of its data, and some


def check_file(path: Path, kind: str = "") -> int:
    """Return the size of a file of somebody else's that may be read: devices never end, large ones fill the memory.

    Args:
        path: of the file.
        kind: by which it is bounded, as `.yaml`; the path's own by default.

    Raises:
        OSError: if there is none, or it is a folder.
        InputError: no regular file, larger, or a pointer of Git LFS.
    """
    about = path.stat()
    if stat.S_ISDIR(about.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(about.st_mode):
        raise InputError(f"{path} is no regular file: copy what it gives into one")
    kind = kind or path.suffix.lower()
    with path.open("rb") as file:
        head = file.read(_HEADER)
    if head.startswith(b"version https://git-lfs."):
        raise InputError(f"{path} is a pointer of Git LFS: fetch what it stands for with git lfs pull")
    if kind == ".ply" and b"format ascii" in head:
        kind = "ascii .ply"
    check_bytes(about.st_size, str(path), kind)
    return about.st_size


def check_bytes(count: int, what: str, kind: str) -> None:
    """Raise `InputError` where something has more bytes than are read of its kind."""
    most = _LARGEST.get(kind, _LARGEST[""])
    if count > most * _MIB:
        read = f"{most} that are read of {kind or 'such'} files"
        raise InputError(f"{what} has {count / _MIB:,.1f} MiB, more than the {read}: save less in it")


@contextmanager
def readable(what: object) -> Iterator[None]:
    """Turn an `OSError` within into one line with the system's reason.

    Raises:
        InputError: for an `OSError` within.
    """
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot read {what}: {error.strerror or error}") from None


def read_file(path: Path, kind: str = "") -> bytes:
    """Return the bytes of a file of somebody else's that `check_file` lets pass."""
    check_file(path, kind)
    return path.read_bytes()


def check_archive(path: Path) -> None:
    """Refuse a zip or npz as `check_file` does, by what it unpacks to as well: no reader unpacks more than it says.

    Raises:
        zipfile.BadZipFile: if it is none.
    """
    check_file(path)
    with zipfile.ZipFile(path) as archive:
        size = sum(member.file_size for member in archive.infolist())
    check_bytes(size, f"{path} unpacked", path.suffix.lower())


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file, 64 digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_npz(path: Path) -> Arrays:
    """Return the arrays of an npz file of somebody else's; pickled ones are not read.

    Raises:
        OSError: if it cannot be read.
        InputError: no regular file, or too large as it is or unpacked.
        ValueError: for what is no archive, a damaged one, or one that holds anything but plain arrays.
    """
    try:
        check_archive(path)
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (OSError, InputError):
        raise
    except Exception as error:  # numpy and zipfile raise whatever they trip over
        raise ValueError(f"no archive of plain arrays ({type(error).__name__})") from None
    for name, array in arrays.items():
        if not isinstance(array, np.ndarray):  # numpy hands the bytes of other members over
            raise ValueError(f"{name[:40]!r} is no array")
    return arrays


def cache_dir() -> Path:
    """Return the cache folder (`DEXGRASP_CACHE` overrides it); it is made when something is written to it."""
    own = os.environ.get("DEXGRASP_CACHE")
    return Path(os.path.expanduser(own)) if own else user_cache_dir()


def user_cache_dir() -> Path:
    """Return the user's cache folder for this package; one of temporary files for a user without a home.

    Where there is none of these either, it is a folder that cannot be made.
    """
    # By the release of platformdirs no home is an error, or stays a tilde.
    with suppress(RuntimeError, OSError):
        path = Path(platformdirs.user_cache_dir("dexgrasp"))
        if path.is_absolute():
            return path
    with suppress(OSError):
        return temporary_cache_dir()
    return Path(os.devnull, "dexgrasp")


def temporary_cache_dir() -> Path:
    """Return a folder of temporary files that only this user can write, as what is read from it is trusted.

    Raises:
        OSError: if it cannot be made, or is somebody else's.
    """
    path = Path(tempfile.gettempdir()) / f"dexgrasp-{os.getuid() if hasattr(os, 'getuid') else 'cache'}"
    path.mkdir(mode=0o700, exist_ok=True)
    about = path.stat(follow_symlinks=False)
    if hasattr(os, "getuid") and (about.st_uid != os.getuid() or about.st_mode & 0o022):
        raise PermissionError(errno.EPERM, "somebody else can write it", str(path))
    return path


def cached_arrays(name: str, make: Callable[[], Arrays]) -> Arrays:
    """Return the arrays of a cache file, made now where it is missing or damaged.

    Several processes may make the same file at once: each replaces it as a whole. A cache that cannot be
    written is done without, with a note on standard error.

    Args:
        name: of the npy file in the cache, named after a hash of all that the arrays depend on, the version of what
            makes them among it.
        make: called for the arrays that are not there.
    """
    path = cache_dir() / name
    arrays = _read_cached(path)
    if arrays is None:
        arrays = make()
        _write_cached(path, arrays)
    return arrays


def _read_cached(path: Path) -> Arrays | None:
    """Return what a file of `_write_cached` holds; nothing is parsed unless every bit is as written.

    The arrays are views of the file's bytes: reading the largest takes a third of what an archive would.
    """
    try:
        content = np.fromfile(path, np.uint8)
    except OSError:
        return None
    size = 32  # bytes of a SHA-256
    payload, digest = content[:-size], content[-size:]
    if hashlib.sha256(payload.data).digest() != digest.tobytes():
        return None
    header = io.BytesIO(payload[:_HEADER].tobytes())
    np.lib.format.read_magic(header)
    dtype = np.lib.format.read_array_header_1_0(header)[2]
    record = np.frombuffer(payload, dtype, 1, header.tell()) if dtype.itemsize else np.zeros(1, dtype)
    return {name: record[name][0] for name in dtype.names or ()}


def _write_cached(path: Path, arrays: Arrays) -> None:
    """Write the arrays as the fields of one record in an npy file, with the hash of its bytes behind it."""
    fields = [(name, array.dtype, array.shape) for name, array in arrays.items()]
    record, buffer = np.zeros(1, np.dtype(fields, align=True)), io.BytesIO()
    for name, array in arrays.items():
        record[name][0] = array
    np.lib.format.write_array(buffer, record, version=(1, 0), allow_pickle=False)
    payload = buffer.getvalue()
    try:
        write_atomically(path, payload + hashlib.sha256(payload).digest())
    except OSError as error:
        note_unwritable(str(cache_dir()), error.strerror or str(error))


@cache
def note_unwritable(folder: str, reason: str) -> None:
    """Print, once in a process, that the cache cannot be written."""
    print(
        f"note: the cache {folder!r} cannot be written ({reason}): going on without it, which takes longer; "
        "DEXGRASP_CACHE names another folder",
        file=sys.stderr,
    )


def content_hash(*parts: object) -> str:
    """Return a 16-digit hash of arrays and printable values."""
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            digest.update(f"{part.dtype}{part.shape}".encode())
            digest.update(part.tobytes())
        else:
            digest.update(repr(part).encode())
    return digest.hexdigest()[:16]


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file so that a killed process leaves the old one or the new one, never half of it.

    Its mode is what the umask leaves of 0666, as of any new file.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.parent / f".{secrets.token_hex(8)}.tmp"
    try:
        with open(temporary, "xb") as file:
            file.write(data)
        os.replace(temporary, path)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            error.filename = str(path)  # a full disk names none
        raise


def write_json(path: Path, content: object) -> None:
    """Write JSON as a whole."""
    write_atomically(path, f"{json.dumps(content, indent=1)}\n".encode())


def lock(file: IO[bytes], busy: str | None = None) -> None:
    """Lock an open file for this process until it is closed.

    Args:
        file: that is locked.
        busy: the error's message; None waits for its turn.

    Raises:
        InputError: `busy`, if another process holds it; or where nothing can be locked.
    """
    try:
        import fcntl
    except ImportError:  # not a Unix: two writers are the user's to avoid
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | (fcntl.LOCK_NB if busy else 0))
    except OSError as error:
        file.close()
        raise InputError(busy or f"{file.name} cannot be locked: {error.strerror}") from None


def expand(path: str | os.PathLike[str]) -> Path:
    """Return a path with its `~` expanded.

    Raises:
        InputError: for a user that there is none of.
    """
    try:
        return Path(path).expanduser()
    except RuntimeError:
        raise InputError(f"{str(path)!r}: there is no such user here") from None
    except TypeError:
        raise InputError(f"{path!r} is no path") from None


def parse_json(text: str | bytes) -> Any:
    """Parse JSON of somebody else's.

    Raises:
        ValueError: for what is no text or no JSON, longer than a file may be, nested beyond the stack, NaN, a number
            that no float holds, or a key that stands twice.
    """
    if len(text) > _LARGEST[".json"] * _MIB:
        raise ValueError("too long")
    try:
        return json.loads(
            text, parse_constant=_refused, parse_float=_finite, parse_int=_whole, object_pairs_hook=_once
        )
    except RecursionError:
        raise ValueError("nested too deeply") from None


def read_json_object(
    path: Path, remedy: str, missing: str | None = None, schema: int | None = None
) -> Fields:
    """Read a file that holds a JSON object.

    Args:
        path: of the file.
        remedy: what to do about a damaged one, for the message.
        missing: the message where there is none to read; None for the system's.
        schema: that it has to state; None for any.

    Raises:
        InputError: missing, unreadable, too large, damaged, JSON of another kind, or of another schema.
    """
    try:
        content = parse_json(read_file(path, ".json"))
    except OSError as error:
        raise InputError(missing or f"cannot read {path}: {error.strerror or error}") from None
    except InputError:
        raise
    except ValueError:
        content = None
    if not isinstance(content, dict):
        raise InputError(f"{path} is damaged, cut off, no JSON object, or has a key twice: {remedy}")
    if schema and content.get("schema") != schema:
        raise InputError(f"{path} has schema {content.get('schema')}, not {schema}: {remedy}")
    return content


def _once(pairs: list[tuple[str, Any]]) -> Fields:
    found = dict(pairs)
    return found if len(found) == len(pairs) else _refused("a key that stands twice")


def _refused(text: str) -> NoReturn:
    raise ValueError(f"{text[:20]} is no number of JSON")


def _finite(text: str) -> float:
    number = float(text)
    return number if math.isfinite(number) else _refused(text)


def _whole(text: str) -> int:
    return int(text) if len(text) <= 40 else _refused(text)  # no seed, count or hash of ours has more


def printable_stem(path: Path) -> str:
    """Return a file's name without its ending as text that can be printed, whatever bytes it is made of."""
    return path.stem.encode("utf-8", "surrogateescape").decode("utf-8", "replace")


def jsonable(value: Any) -> Any:
    """Return a value as JSON can hold it: arrays as lists, NaN and infinities as None, the unknown as text."""
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, (np.generic, np.ndarray)):
        plain = value.tolist()
        of_numbers = value.dtype.kind in "biu" or (value.dtype.kind == "f" and bool(np.isfinite(value).all()))
        return plain if of_numbers else jsonable(plain)
    if isinstance(value, (int, float)):
        return value if math.isfinite(value) else None
    if isinstance(value, (list, tuple, set)):  # of an array that was made plain before: thousands of numbers
        return [item if type(item) is float and math.isfinite(item) else jsonable(item) for item in value]
    if isinstance(value, Mapping):
        return {str(key): jsonable(item) for key, item in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: jsonable(getattr(value, field.name)) for field in fields(value)}
    return str(value)
