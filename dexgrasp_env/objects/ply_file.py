"""PLY files against what their headers count: what follows is left out, and what is cut off is told."""

import re
from typing import NamedTuple

_HEADER = re.compile(rb"\Aply\r?\n.*?^[ \t]*end_header[ \t]*\r?\n", re.DOTALL | re.MULTILINE)
_BYTES = {
    "char": 1, "uchar": 1, "int8": 1, "uint8": 1, "short": 2, "ushort": 2, "int16": 2, "uint16": 2, "int": 4, "uint": 4,
    "int32": 4, "uint32": 4, "float": 4, "float32": 4, "double": 8, "float64": 8,
}  # fmt: skip


class _Element(NamedTuple):
    """Rows of one kind: how many, and the types of each; of a list, those of its count and its entries."""

    number: int
    types: list[tuple[str, ...]]


def whole_ply(data: bytes) -> bytes:
    """Return a PLY file without what follows its last element.

    Raises:
        EOFError: for one that is cut off; where, in words.
    """
    header = _HEADER.match(data)
    if header is None:
        return data
    elements = _elements(header[0].decode("ascii", "replace"))
    if b"format ascii" in header[0]:
        return _whole_text(data, header.end(), elements)
    end, big = header.end(), b"format binary_big" in header[0]
    for element in elements:
        end = _end(data, end, element, big)
    if end > len(data):
        raise EOFError(f"it ends after {len(data):,} of {end:,} bytes")
    return data[:end]


def _elements(header: str) -> list[_Element]:
    found = list[_Element]()
    for line in header.splitlines():
        word, *rest = line.split() or [""]
        if word == "element":
            found.append(_Element(int(rest[1]), []))
        elif word == "property":
            found[-1].types.append(tuple(rest[1:3]) if rest[0] == "list" else (rest[0],))
    return found


def _whole_text(data: bytes, begin: int, elements: list[_Element]) -> bytes:
    """Return a text with as many rows as it counts."""
    rows, wanted = data[begin:].split(b"\n"), sum(element.number for element in elements)
    filled = [k for k, row in enumerate(rows) if row.strip()]
    if len(filled) < wanted or (wanted and _short(rows[filled[wanted - 1]].split(), elements)):
        raise EOFError(f"it ends after {min(len(filled), wanted - 1)} of {wanted} rows")
    return data[:begin] + b"\n".join(rows[k] for k in filled[:wanted]) + b"\n"


def _short(words: list[bytes], elements: list[_Element]) -> bool:
    """Return whether a row of the last element lacks words."""
    needed = 0
    for types in next(element for element in reversed(elements) if element.number).types:
        if needed >= len(words):
            return True
        needed += 1 + (int(words[needed]) if len(types) == 2 else 0)
    return len(words) < needed


def _end(data: bytes, begin: int, element: _Element, big: bool) -> int:
    """Return where the rows of an element end that begin at a byte."""
    if all(len(types) == 1 for types in element.types):
        return begin + element.number * sum(_BYTES[types[0]] for types in element.types)
    first = _row_end(data, begin, element, big) - begin
    if begin + element.number * first == len(data):  # all rows are as long as the first: nothing follows
        return len(data)
    end = begin
    for _ in range(element.number):
        end = _row_end(data, end, element, big)
        if end > len(data):
            break
    return end


def _row_end(data: bytes, begin: int, element: _Element, big: bool) -> int:
    end = begin
    for types in element.types:
        end += _BYTES[types[0]] + (_entries(data, end, types, big) if len(types) == 2 else 0)
    return end


def _entries(data: bytes, at: int, types: tuple[str, ...], big: bool) -> int:
    """Return the bytes of a list's entries."""
    count = int.from_bytes(data[at : at + _BYTES[types[0]]], "big" if big else "little")
    return count * _BYTES[types[1]]
