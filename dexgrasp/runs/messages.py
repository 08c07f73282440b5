"""Messages between processes that need not trust each other: mappings with arrays, as msgpack.

Arrays are written as the package `openpi-client` writes them, a mapping of `__ndarray__`, `data`, `dtype`, `shape`, so
that its classes understand what is sent here. Nothing is made but numbers, text, lists, mappings and arrays of numbers.
"""

import math
import re
from typing import Any

import numpy as np

from dexgrasp_env.arrays import AnyArray, Fields
from dexgrasp_env.errors import InputError, first_line
from dexgrasp_env.extras import from_extra

_KINDS = "biuf"


def pack(message: Fields) -> bytes:
    """Return a message as bytes.

    Raises:
        TypeError: for a value that is neither plain nor an array of numbers.
    """
    with from_extra():
        import msgpack

    packed: bytes = msgpack.packb(message, default=_plain)
    return packed


def unpack(data: bytes) -> Fields:
    """Return the message that bytes hold; its arrays are copies that may be written to.

    Raises:
        InputError: for bytes that hold no mapping, or an array that is none.
    """
    with from_extra():
        import msgpack
    try:
        message = msgpack.unpackb(data, object_hook=_array)
    except InputError:
        raise
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise InputError(f"a message is a msgpack mapping: {first_line(error) or 'cut off'}") from None
    if not isinstance(message, dict) or not all(isinstance(key, str) for key in message):
        raise InputError("a message is a msgpack mapping with text as keys")
    return message


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray) and value.dtype.kind in _KINDS:
        return {
            b"__ndarray__": True,
            b"data": value.tobytes(),
            b"dtype": value.dtype.str,
            b"shape": value.shape,
        }
    if isinstance(value, np.generic) and value.dtype.kind in _KINDS:
        return {b"__npgeneric__": True, b"data": value.item(), b"dtype": value.dtype.str}
    raise TypeError(f"a {type(value).__name__} cannot be sent")


def _array(given: dict[Any, Any]) -> Any:
    """Return the array that a mapping stands for, any other mapping as it is."""
    if b"__ndarray__" in given:
        return _of_bytes(given.get(b"data"), _dtype(given.get(b"dtype")), given.get(b"shape"))
    if b"__npgeneric__" in given:
        return _dtype(given.get(b"dtype")).type(given.get(b"data"))
    return given


def _of_bytes(data: Any, dtype: "np.dtype[Any]", shape: Any) -> AnyArray:
    sizes: list[Any] = shape if isinstance(shape, list) else [None]
    if not all(type(size) is int and size >= 0 for size in sizes) or len(sizes) > 32:
        raise InputError(f"an array has shape {str(shape)[:80]}: valid are whole numbers from 0 on")
    if not isinstance(data, bytes) or len(data) != math.prod(sizes) * dtype.itemsize:
        raise InputError(f"the data of an array are not the bytes of {dtype} of shape {tuple(sizes)}")
    return np.frombuffer(data, dtype).reshape(sizes).copy()


def _dtype(name: Any) -> "np.dtype[Any]":
    text = name.decode("ascii", "replace") if isinstance(name, bytes) else str(name)
    if not re.fullmatch(r"[<>|=]?(b1|[iu][1248]|f[248])", text):
        raise InputError(f"an array has dtype {text[:40]!r}: valid are booleans, whole and floating numbers")
    return np.dtype(text)
