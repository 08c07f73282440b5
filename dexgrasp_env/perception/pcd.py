"""Clouds of the Point Cloud Library: PCD files of format 0.7, as text, binary, or binary and compressed."""

import io
from itertools import islice
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import check_bytes
from dexgrasp_env.perception.cloud import check_count

_LINES = 1_000  # of a header
_TYPES = {("F", 4): "<f4", ("F", 8): "<f8", ("I", 1): "<i1", ("I", 2): "<i2", ("I", 4): "<i4", ("I", 8): "<i8",
          ("U", 1): "<u1", ("U", 2): "<u2", ("U", 4): "<u4", ("U", 8): "<u8"}  # fmt: skip


def read_pcd(path: Path) -> Array:
    """Return x, y, z (N, 3) of a file, in its unit.

    Raises:
        InputError: for what is no PCD file, lacks coordinates, is cut off or has too many points.
        Exception: whatever else a damaged file makes the parser trip over.
    """
    file = io.BytesIO(path.read_bytes())
    header = _header(file, path)
    names, count, kind = header["FIELDS"], int(header["POINTS"][0]), " ".join(header["DATA"])
    check_count(count, str(path))
    if not {"x", "y", "z"} <= set(names):
        raise InputError(f"{path} has fields {' '.join(names)}: x, y and z are needed")
    columns = [names.index(axis) for axis in "xyz"]
    if kind == "ascii":
        return np.loadtxt(file, ndmin=2, max_rows=count)[:, columns]
    if kind not in ("binary", "binary_compressed"):
        raise InputError(f"{path}: PCD data {kind!r} is none of ascii, binary and binary_compressed")
    repeats = map(int, header.get("COUNT", ["1"] * len(names)))
    kinds = zip(header["TYPE"], map(int, header["SIZE"]), repeats, strict=True)
    row = np.dtype([(f"f{i}", _TYPES[letter, size], (n,)) for i, (letter, size, n) in enumerate(kinds)])
    check_bytes(count * row.itemsize, f"{path} unpacked", ".pcd")
    table = (
        _plain(file.read(), row, count, path) if kind == "binary" else _packed(file.read(), row, count, path)
    )
    return np.stack([table[k][:, 0] for k in columns], axis=1).astype(float)


def _plain(body: bytes, row: np.dtype[Any], count: int, path: Path) -> list[NDArray[Any]]:
    """Return the fields, which follow each other in each point."""
    if len(body) < count * row.itemsize:
        raise InputError(f"{path} ends after {len(body) // row.itemsize} of {count} points: it was cut off")
    table = np.frombuffer(body, row, count)
    return [table[str(name)] for name in row.names or ()]


def _packed(body: bytes, row: np.dtype[Any], count: int, path: Path) -> list[NDArray[Any]]:
    """Return the fields, which are packed one after the other, by LZF."""
    from dexgrasp_env.perception.lzf import unpack

    sizes = np.frombuffer(body, "<u4", 2)
    data = unpack(np.frombuffer(body[8 : 8 + int(sizes[0])], np.uint8), count * row.itemsize)
    if data is None or int(sizes[1]) != len(data):
        raise InputError(f"{path}: its compressed points are damaged or cut off")
    found, start = [], 0
    for name in row.names or ():
        kind = row[name]
        found.append(np.frombuffer(data, kind.base, count * kind.shape[0], start).reshape(count, -1))
        start += count * kind.itemsize
    return found


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
