"""Reader of PLY files, where the mesh library needs help: commas, polygons of many sizes, bytes behind the last row."""

import io
import re
import struct
from contextlib import suppress
from typing import Any

import numpy as np
import trimesh

from dexgrasp_env.texts import plain_text, rows_of


class DamagedMeshError(ValueError):
    """A mesh file that ends before it says; where, in words."""


def load_ply(data: bytes) -> Any:
    """Return what a PLY file holds, as the mesh library does: a mesh or points.

    Raises:
        DamagedMeshError: for a binary one that is cut off.
        Exception: whatever else a damaged file makes the parser trip over.
    """
    data = plain_text(data)
    head, end, body = data.partition(b"end_header")
    if b"format ascii" in head:
        return _loaded(head + end + "\n".join(rows_of(body)).encode())
    with suppress(ValueError):
        loaded = _loaded(data)
        if _even(loaded):
            return loaded
    return _loaded(_as_text(data))


def _loaded(data: bytes) -> Any:
    return trimesh.load(io.BytesIO(data), file_type="ply", process=False)


def _even(loaded: Any) -> bool:
    """Return whether each list of a binary file has one length: the library reads all by the first."""
    tables = [element["data"] for element in loaded.metadata["_ply_raw"].values() if element["length"]]
    lists = [table[name] for table in tables for name in table.dtype.names if table[name].dtype.names]
    return all((rows["f0"] == np.prod(rows["f1"].shape[1:])).all() for rows in lists)


def _as_text(data: bytes) -> bytes:
    """Return a binary file as a text, without what follows its last row."""
    file = io.BytesIO(data)
    elements = trimesh.exchange.ply._parse_header(file)[0]
    head = re.sub(rb"format \S+", b"format ascii", data[: file.tell()], count=1)
    lines = [head.decode("utf-8", "replace").rstrip()]

    def values(kind: str, count: int) -> tuple[Any, ...]:
        """Return the next values."""
        form = f"{kind[0]}{count}{np.dtype(kind).char}"
        return struct.unpack(form, file.read(struct.calcsize(form)))

    for name, element in elements.items():
        for row in range(element["length"]):
            words = list[Any]()
            try:
                for kind in element["properties"].values():
                    first, _, each = kind.partition(", ($LIST,)")
                    words += (own := values(first, 1))
                    words += values(each, own[0]) if each else ()
            except struct.error:
                raise DamagedMeshError(f"it ends after {row} of {element['length']} rows of {name}") from None
            lines.append(" ".join(map(str, words)))
    return "\n".join(lines).encode() + b"\n"
