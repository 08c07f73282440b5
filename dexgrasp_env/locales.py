"""Decimal points for C libraries that read numbers by the locale, as MuJoCo does in OBJ files."""

import locale
from collections.abc import Callable
from threading import RLock
from typing import TypeVar

T = TypeVar("T")
_LOCK = RLock()  # the locale is the process's


def with_decimal_points(call: Callable[..., T], *args: object) -> T:
    """Return what a call gives where numbers have decimal points, whatever locale the program has set (Qt sets one)."""
    with _LOCK:
        if locale.localeconv()["decimal_point"] == ".":
            return call(*args)
        before = locale.setlocale(locale.LC_NUMERIC)
        locale.setlocale(locale.LC_NUMERIC, "C")
        try:
            return call(*args)
        finally:
            locale.setlocale(locale.LC_NUMERIC, before)
