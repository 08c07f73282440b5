"""Pickled dictionaries of arrays, read without executing anything: only arrays, numbers, text and containers pass.

`np.load(..., allow_pickle=True)` runs whatever a file asks for. Here a name that is not on the list ends the reading
before it is looked up.
"""

import io
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp_env.errors import InputError

_LARGEST = 1 << 30  # bytes of a file


def _latin1(text: str, encoding: str) -> bytes:
    """Stand in for `_codecs.encode`, by which old pickles hold bytes."""
    if encoding != "latin1":
        raise pickle.UnpicklingError(f"text encoded as {encoding}")
    return text.encode("latin1")


def _numpy_function(name: str) -> Callable[..., Any]:
    module = np._core.numeric if name == "_frombuffer" else np._core.multiarray  # type: ignore[attr-defined]
    found: Callable[..., Any] = getattr(module, name)
    return found


_ALLOWED: dict[tuple[str, str], Any] = {
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
    ("_codecs", "encode"): _latin1,
    **{
        (f"numpy.{core}.{module}", name): _numpy_function(name)
        for core in ("core", "_core")
        for module, name in (
            ("multiarray", "_reconstruct"),
            ("multiarray", "scalar"),
            ("numeric", "_frombuffer"),
        )
    },
}


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in _ALLOWED:
            raise pickle.UnpicklingError(f"it asks for {module}.{name}")
        return _ALLOWED[module, name]

    def persistent_load(self, pid: Any) -> Any:
        raise pickle.UnpicklingError("it refers to objects outside the file")


def read_dictionary(path: Path) -> dict[str, Any]:
    """Return the dictionary of arrays, numbers and texts that an .npy (or .pkl) file holds.

    Raises:
        InputError: if the file is missing or damaged, holds something else, or asks for anything but arrays.
    """
    try:
        if path.stat().st_size > _LARGEST:
            raise InputError(f"{path} is larger than {_LARGEST >> 30} GB: split it")
        content = _load(path.read_bytes())
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    except pickle.UnpicklingError as error:
        reason = str(error) or "damaged"
        raise InputError(
            f"{path} is not read ({reason}): valid are dictionaries of arrays, numbers and text"
        ) from None
    except InputError:
        raise
    except Exception as error:  # a damaged pickle fails in any way it likes, none of them ours to run into
        raise InputError(f"{path} is damaged or no pickled dictionary ({type(error).__name__})") from None
    if isinstance(content, np.ndarray) and content.shape == () and content.dtype == object:
        content = content.item()
    if not isinstance(content, dict) or not all(isinstance(key, str) for key in content):
        raise InputError(
            f"{path} holds no dictionary: valid are dictionaries of arrays as np.save writes them"
        )
    return content


def _load(data: bytes) -> Any:
    file = io.BytesIO(data)
    if not data.startswith(b"\x93NUMPY"):
        return _Unpickler(file).load()
    version = np.lib.format.read_magic(file)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }.get(version)
    if read_header is None:
        raise pickle.UnpicklingError(f"npy version {version}")
    dtype = read_header(file)[2]
    return _Unpickler(file).load() if dtype.hasobject else None
