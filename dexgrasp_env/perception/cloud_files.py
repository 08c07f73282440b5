"""Readers of recorded clouds, by the ending of their files: what they return are rows of x, y, z in the file's unit."""

import io
import re
from collections.abc import Callable
from functools import partial
from itertools import islice
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra
from dexgrasp_env.files import check_bytes, check_file, read_npz
from dexgrasp_env.perception.cloud import check_count
from dexgrasp_env.texts import plain_text, rows_of

_LINES = 1_000  # of a header
_EMPTY_CELL = re.compile(r"(?<=[,;])\s*(?=[,;]|$)|^(?=[,;])")
_NAMES = ("points", "xyz", "pc", "cloud", "pos", "vertices")  # of the cloud among the arrays of an npz file


def check_scan(path: Path) -> None:
    """Raise `InputError` where a file cannot be read, is none, is empty, or is too large for a scan."""
    try:
        if not check_file(path):
            raise InputError(f"{path} is empty: record it again")
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None


def read_pcd(path: Path) -> Array:
    """Return x, y, z (N, 3) of a file, in its unit.

    Raises:
        InputError: for what is no PCD file, lacks coordinates, is cut off or has too many points.
        Exception: whatever else a damaged file makes the parser trip over.
    """
    file = io.BytesIO(plain_text(path.read_bytes()))
    header = _header(file, path)
    names, count, kind = header["FIELDS"], int(header["POINTS"][0]), " ".join(header["DATA"])
    check_count(count, str(path))
    if not {"x", "y", "z"} <= set(names):
        raise InputError(f"{path} has fields {' '.join(names)}: x, y and z are needed")
    columns = [names.index(axis) for axis in "xyz"]
    repeats = [int(number) for number in header.get("COUNT", ["1"] * len(names))]
    if count < 1:
        raise InputError(f"{path} has {count} points: it is empty, or its header is damaged")
    if kind == "ascii":
        table = np.loadtxt(rows_of(file.read()), ndmin=2, max_rows=count)
        if len(table) < count:
            raise InputError(f"{path} ends after {len(table)} of {count} points: it was cut off")
        return table[:, [sum(repeats[:k]) for k in columns]]
    packed, body = kind == "binary_compressed", file.read()
    if not packed and kind != "binary":
        raise InputError(f"{path}: PCD data {kind!r} is none of ascii, binary and binary_compressed")
    kinds = zip(header["TYPE"], map(int, header["SIZE"]), repeats, strict=True)
    row = np.dtype([(f"f{i}", f"<{letter.lower()}{wide}", (n,)) for i, (letter, wide, n) in enumerate(kinds)])
    size = count * row.itemsize
    check_bytes(size, f"{path} unpacked", ".pcd")
    if packed:  # the fields follow each other, instead of the points
        body = _unpacked(body, size, path)
        row = np.dtype([(name, row[name], (count,)) for name in row.names or ()])
    elif len(body) < size:
        raise InputError(f"{path} ends after {len(body) // row.itemsize} of {count} points: it was cut off")
    records = np.frombuffer(body, row, 1 if packed else count)
    return np.stack([records[f"f{k}"].reshape(count, -1)[:, 0] for k in columns], axis=1).astype(float)


def _unpacked(body: bytes, size: int, path: Path) -> bytes:
    """Return `size` bytes that were packed by LZF."""
    import lzf

    packed, whole = np.frombuffer(body, "<u4", 2).tolist()
    try:
        data = lzf.decompress(body[8 : 8 + packed], size)
    except ValueError:
        data = None
    if data is None or len(data) != size or whole != size:
        raise InputError(f"{path}: its compressed points are damaged or cut off")
    return bytes(data)


def _header(file: IO[bytes], path: Path) -> dict[str, list[str]]:
    fields: dict[str, list[str]] = {}
    for line in islice(file, _LINES):
        words = line.decode("ascii", "replace").split()
        if words and not words[0].startswith("#"):
            fields[words[0].upper()] = words[1:]
        if "DATA" in fields:
            break
    missing = [key for key in ("FIELDS", "SIZE", "TYPE", "POINTS", "DATA") if not fields.get(key)]
    if missing:
        raise InputError(f"{path} is no PCD file: its header lacks {', '.join(missing)}")
    return fields


def _read_ply(path: Path) -> Array:
    from dexgrasp_env.ply_file import load_ply

    loaded = load_ply(path.read_bytes())
    vertices = getattr(loaded, "vertices", None)
    if vertices is None or not len(vertices):
        raise InputError(f"{path} holds no vertices")
    if len(vertices) != (stated := loaded.metadata["_ply_raw"]["vertex"]["length"]):
        raise InputError(f"{path} ends after {len(vertices)} of {stated} points: it was cut off")
    return np.asarray(vertices, dtype=float)


def _read_npz(path: Path) -> NDArray[Any]:
    arrays = read_npz(path)
    name = next((name for name in (*_NAMES, *arrays) if name in arrays), None)
    if name is None or (name not in _NAMES and len(arrays) > 1):
        raise InputError(f"{path} has arrays {', '.join(arrays) or 'none'}: name the cloud 'points' or 'xyz'")
    return arrays[name]


def _read_text(path: Path) -> Array:
    """Read rows of x, y, z and whatever follows, apart by blanks, commas or semicolons.

    Remarks (`#`, `//`), the names of columns and a count may stand above them, as CloudCompare writes them. Columns
    named x, y and z are taken wherever they stand, else the first three.
    """
    lines = rows_of(path.read_bytes())
    start = next((k for k, line in enumerate(lines[:_LINES]) if _is_row(line)), 0)
    bare = (re.sub(r"\[.*?\]|\(.*?\)|^[#/\s]+|[\"']", "", line.lower()) for line in lines[:start])  # of units
    named = (re.split(r"\s*[,;]\s*|\s+", line) for line in bare)
    names = next((names for names in named if {*"xyz"} <= {*names}), [*"xyz"])
    rows = (_EMPTY_CELL.sub("nan", line).replace(",", " ").replace(";", " ") for line in lines[start:])
    columns = [names.index(axis) for axis in "xyz"]
    return np.loadtxt(rows, ndmin=2, usecols=columns, comments=("#", "//"))


def _is_row(line: str) -> bool:
    """Tell a row of coordinates from what may stand above it."""
    words = line.replace(",", " ").replace(";", " ").split()[:3]
    try:
        return len([float(word) for word in words]) == 3
    except ValueError:
        return False


def _read_las(path: Path) -> Array:
    with from_extra():
        import laspy

        if path.suffix.lower() == ".laz":
            import lazrs  # noqa: F401
    with path.open("rb") as head:
        # Where points begin, and how many records before them, of 54 bytes at least; laspy reads past the file's end.
        points, records = np.frombuffer(head.read(104)[96:], "<u4").tolist()
    if 54 * records > min(points, path.stat().st_size):
        raise InputError(f"{path} is damaged: its header says that {records} records stand before the points")
    with laspy.open(path, read_evlrs=False) as file:
        check_count(file.header.point_count, str(path))
        return np.asarray(file.read().xyz, dtype=float)


READERS: dict[str, Callable[[Path], NDArray[Any]]] = {
    ".ply": _read_ply, ".pcd": read_pcd, ".npy": partial(np.load, allow_pickle=False), ".npz": _read_npz,
    **dict.fromkeys((".xyz", ".txt", ".csv", ".pts", ".asc"), _read_text),
    **dict.fromkeys((".las", ".laz"), _read_las),
}  # fmt: skip
"""What reads clouds, by the ending of their files."""
