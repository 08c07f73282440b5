"""Pickles of other people, read without running anything that their authors put in.

`pickle` makes whatever a file asks for. Here a name that is not known to do no harm ends the reading before it is
looked up.
"""

import importlib
import io
import pickle
import re
from collections.abc import Set
from typing import Any

_ARRAYS = {
    ("numpy", "ndarray"), ("numpy", "dtype"), ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "scalar"), ("numpy._core.numeric", "_frombuffer"),
}  # fmt: skip


def unpickle(
    data: bytes, names: Set[tuple[str, str]] = frozenset(), classes: re.Pattern[str] | None = None
) -> Any:
    """Return what a pickle of arrays, numbers, text and containers holds.

    Args:
        data: of the pickle.
        names: module and name of what else may be made.
        classes: matches the modules of which any class may be made.

    Raises:
        pickle.UnpicklingError: if it asks for anything else. Damaged ones fail with errors of any kind.
    """
    return _Reader(data, _ARRAYS | names, classes).load()


class _Reader(pickle.Unpickler):
    """Makes known objects alone."""

    def __init__(self, data: bytes, names: Set[tuple[str, str]], classes: re.Pattern[str] | None) -> None:
        super().__init__(io.BytesIO(data))
        self._names, self._classes = names, classes

    def find_class(self, module: str, name: str) -> Any:
        """Return a class or constructor that is known to do no harm."""
        module = re.sub(r"^numpy\.core\b", "numpy._core", module)
        if (module, name) == ("_codecs", "encode"):
            return _latin1
        if (module, name) in self._names:
            return getattr(importlib.import_module(module), name)
        if self._classes is not None and self._classes.fullmatch(module):
            found = getattr(importlib.import_module(module), name, None)
            if isinstance(found, type):
                return found
        raise pickle.UnpicklingError(f"it asks for {module}.{name}, which might run code of its author")


def _latin1(text: str, encoding: str) -> bytes:
    """Stand in for `_codecs.encode`, by which old pickles hold bytes."""
    if encoding != "latin1":
        raise pickle.UnpicklingError(f"text encoded as {encoding}")
    return text.encode("latin1")
