"""Texts as other programs write them: byte order marks, and commas for decimal points."""

import codecs
import re
from collections.abc import Sequence

_NUMBER = r"[-+]?\d+(?:,\d+)?(?:[eE][-+]?\d+)?(?![^;\s])"
_DECIMAL_COMMAS = re.compile(rf"\s*(?:[A-Za-z]+\s+)*{_NUMBER}(?:[;\s]+{_NUMBER}){{2,}}")


def plain_text(data: bytes) -> bytes:
    """Return a text without the byte order mark that editors put before it; UTF-16 becomes UTF-8."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", "replace").encode()
    return data.removeprefix(codecs.BOM_UTF8)


def rows_of(data: bytes) -> list[str]:
    """Return the lines of a text without a byte order mark, with decimal points; bytes that are no text are marked."""
    return without_decimal_commas(plain_text(data).decode("utf-8", "replace").splitlines())


def without_decimal_commas(lines: Sequence[str]) -> list[str]:
    """Return a table's lines with points where commas stand for them: numbers are then apart by blanks or semicolons.

    One row of three numbers or more tells it of all, as there may be whole numbers alone in the first ones.
    """
    rows = (found.group() for line in lines if "," in line and (found := _DECIMAL_COMMAS.match(line)))
    return [line.replace(",", ".") for line in lines] if any("," in row for row in rows) else list(lines)
