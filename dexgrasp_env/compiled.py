"""The decorator of compiled functions: numba's, with the options that all of them share. It imports numba.

What is compiled is kept on disk, and a division by zero gives what numpy gives. A constant in a call between compiled
functions makes no version of its own, and no wrapper for C callbacks is made: neither is of use here, and both together
are a fifth of the compilation.
"""

import os
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, cast

from numba.core import caching, types
from numba.core import config as numba_config
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher

from dexgrasp_env.files import cache_dir, note_unwritable, temporary_cache_dir, user_cache_dir

F = TypeVar("F", bound=Callable[..., Any])

config: Any = numba_config  # its names are made at run time
_LEVEL = type(config.OPT)("2")  # of LLVM's optimisation


def njit(function: F, **options: Any) -> F:
    """Compile a function at its first call, for the types of its arguments.

    Args:
        function: of a module, found there by its name.
        **options: more of numba's.
    """
    if config.DISABLE_JIT:
        return function
    shared = {"nopython": True, "error_model": "numpy", "no_cfunc_wrapper": True}
    kernel = _Kernel(function, targetoptions=shared | options)
    kernel.enable_caching()
    return cast(F, kernel)


def code_folder() -> Path | None:
    """Return where this package's compiled code is kept; None for nowhere but in memory."""
    try:
        return Path(_KernelCache(njit).cache_path)
    except RuntimeError:
        return None


class _Kernel(CPUDispatcher):
    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Resolve a call from a compiled function: a constant is a number like others."""
        plain = {name: types.unliteral(kind) for name, kind in kws.items()}
        return super().get_call_template(tuple(types.unliteral(kind) for kind in args), plain)

    def compile(self, sig: Any) -> Any:
        """Compile for types at a lower level than numba's 3: the first plan comes a quarter sooner."""
        with global_compiler_lock:  # numba asks for the levels while it compiles, and has no option for them
            before = config.OPT, config.LOOP_VECTORIZE
            if "NUMBA_OPT" not in os.environ:
                config.OPT, config.LOOP_VECTORIZE = _LEVEL, 0
            try:
                return super().compile(sig)
            finally:
                config.OPT, config.LOOP_VECTORIZE = before

    def enable_caching(self) -> None:
        """Keep what is compiled on disk, where any of the folders can be written."""
        try:
            self._cache = _KernelCache(self.py_func)
        except RuntimeError:  # no folder: it is kept in memory
            note_unwritable(str(cache_dir()), "nor the folders of the code, the user, temporary files")


class _BesideCode(caching.InTreeCacheLocator):
    """The folder beside the code; where it can only be read, as in an image, for what has been kept there."""

    @classmethod
    def from_function(cls, function: Any, file: str) -> Any:
        """Return where a function is kept; None where nothing can be and nothing is."""
        try:
            found = super().from_function(function, file)
        except OSError:  # no folder of temporary files
            return None
        return found or cls._kept(function, file)

    @classmethod
    def _kept(cls, function: Any, file: str) -> Any:
        """Return a folder with the function's code in it; for `njit` one with the mark that all was compiled there."""
        name, python = re.sub("[<>]", "", function.__qualname__), "".join(map(str, sys.version_info[:2]))
        index = f"{Path(file).stem}.{name}-{function.__code__.co_firstlineno}.py{python}*.nbi"
        with suppress(OSError):
            there = cls(function, file)
            if any(Path(there.get_cache_path()).glob("compiled-*" if function is njit else index)):
                return there
        return None


class _CacheDir(_BesideCode):
    """A folder as `numba` under DEXGRASP_CACHE, where the code's own cannot be written."""

    folder = staticmethod(cache_dir)

    def __init__(self, function: Any, file: str) -> None:
        super().__init__(function, file)
        self._cache_path = os.path.join(self.folder(), "numba", self.get_suitable_cache_subpath(file))


class _UserCacheDir(_CacheDir):
    folder = staticmethod(user_cache_dir)


class _TemporaryDir(_CacheDir):
    folder = staticmethod(temporary_cache_dir)


class _CacheFiles(caching.CompileResultCacheImpl):
    _locator_classes = [  # noqa: RUF012  (numba's name)
        caching.UserProvidedCacheLocator, _BesideCode, _CacheDir, _UserCacheDir, _TemporaryDir,
    ]  # fmt: skip


class _KernelCache(caching.FunctionCache):
    _impl_class = _CacheFiles

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep compiled code; a full disk is done without."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            note_unwritable(self.cache_path, error.strerror or str(error))
            self.disable()
