"""The decorator of compiled functions: numba's, with the options that all of them share. It imports numba.

What is compiled is kept on disk, and a division by zero gives what numpy gives. A constant in a call between compiled
functions makes no version of its own, no wrapper for C callbacks is made, and what only compiled functions call is
emitted within those that Python calls: the rest of numba's work is of no use here, and is half of the compilation.
"""

import gc
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar, cast

from llvmlite import binding as llvm
from numba.core import caching, codegen, types
from numba.core import config as numba_config
from numba.core.compiler_lock import global_compiler_lock
from numba.core.environment import lookup_environment
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
    shared = {"nopython": True, "error_model": "numpy", "no_cfunc_wrapper": True, "_nrt": True}
    kernel = _Kernel(function, targetoptions=shared | options)
    kernel.enable_caching()
    return cast(F, kernel)


def wide(function: F) -> F:
    """Compile a function whose loops handle several numbers at once, which takes longer and is seldom faster."""
    kernel = njit(function)
    vars(kernel)["vectorized"] = True
    return kernel


def leaf(function: F) -> F:
    """Compile a function that neither makes nor returns arrays, nor calls one that does: no references are counted."""
    return njit(function, _nrt=False)


def code_folder() -> Path | None:
    """Return where this package's compiled code is kept; None for nowhere but in memory."""
    try:
        return Path(_KernelCache(njit).cache_path)
    except RuntimeError:
        return None


@contextmanager
def uncollected() -> Iterator[None]:
    """Search for no cycles within a block: a compiler makes many objects, all of which each search would visit."""
    searches = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if searches:
            gc.enable()


class _Library(codegen.JITCodeLibrary):
    """Code of one function, made the machine's only where Python calls it, with all that it calls.

    numba optimises and emits each function alone and again within each of its callers, which takes twice as long.
    """

    _for_python = False

    @property
    def codegen(self) -> Any:
        """Return where an environment is set: nowhere before the code is emitted."""
        return super().codegen if self._for_python else _NoEnvironment

    def get_pointer_to_function(self, name: str) -> int:
        """Return the address of the function that Python calls, 0 where it calls none."""
        if not self._finalized:
            self._for_python = any(function.name == name for function in self._final_module.functions)
        return int(super().get_pointer_to_function(name)) if self._for_python else 0

    def serialize_using_object_code(self) -> Any:
        """Return what is kept on disk: bitcode, or the machine's code and in place of bitcode its functions' names.

        Nothing is linked with what Python calls, and the bitcode takes longer to load than the code.
        """
        if not self._for_python:
            return self.serialize_using_bitcode()
        self._ensure_finalized()
        names = [one.name for one in self._final_module.functions if not one.is_declaration]
        stub = llvm.parse_assembly("\n".join(f'define void @"{name}"() {{ ret void }}' for name in names))
        return self.name, "object", (self._get_compiled_object(), stub.as_bitcode())

    def _optimize_functions(self, ll_module: Any) -> None:
        """Simplify: all of LLVM's passes follow where Python calls it."""
        ll_module.data_layout = self._codegen._data_layout
        manager, builder = (
            llvm.newpassmanagers.create_new_function_pass_manager(),
            self._codegen._pass_builder(),
        )
        manager.add_sroa_pass()
        manager.add_simplify_cfg_pass()
        manager.add_instruction_combine_pass()
        manager.add_refprune_pass()
        for function in ll_module.functions:
            if not function.is_declaration:
                manager.run(function, builder)

    def _optimize_final_module(self) -> None:
        if self._for_python:
            super()._optimize_final_module()

    def _finalize_final_module(self) -> None:
        if not self._for_python:
            self._finalize_dynamic_globals()
            self._finalized = True
            return
        super()._finalize_final_module()
        for name in (variable.name for variable in self._final_module.global_variables):
            if (
                environment := lookup_environment(name)
            ) is not None:  # of one called, which had none to be set in
                self.codegen.set_env(name, environment)

    def _set_compiled_object(self, value: bytes) -> None:
        self._for_python = True  # of what was kept
        super()._set_compiled_object(value)


class _NoEnvironment:
    @staticmethod
    def set_env(name: str, env: Any) -> None:
        """Do nothing; see `_finalize_final_module`."""


class _Compiled(CPUDispatcher):
    """A function for types of arguments; compiled where either Python or a compiled function calls it with those."""

    _files: type[caching.FunctionCache]
    vectorized = False

    def compile(self, sig: Any) -> Any:
        """Compile for types, at a lower level than numba's 3."""
        maker = cast(Any, self.targetctx).codegen()
        # numba asks for these while it compiles, and has no option for them
        with global_compiler_lock, uncollected():
            before = config.OPT, config.LOOP_VECTORIZE, maker._library_class
            maker._library_class = _Library
            if "NUMBA_OPT" not in os.environ:
                config.OPT, config.LOOP_VECTORIZE = _LEVEL, int(self.vectorized)
            try:
                return super().compile(sig)
            finally:
                config.OPT, config.LOOP_VECTORIZE, maker._library_class = before

    def enable_caching(self) -> None:
        """Keep what is compiled on disk, where any of the folders can be written."""
        try:
            self._cache = self._files(self.py_func)
        except RuntimeError:  # no folder: it is kept in memory
            note_unwritable(str(cache_dir()), "nor the folders of the code, the user, temporary files")


class _Folder(caching.InTreeCacheLocator):
    """The first folder that can be written: beside the code, then `numba` in the folders of caches.

    Beside the code, as in an image, what has been kept is read where nothing can be written.
    """

    @classmethod
    def from_function(cls, function: Any, file: str) -> Any:
        """Return where a function is kept; None for nowhere."""
        for root in (None, cache_dir, user_cache_dir, temporary_cache_dir):
            place = cls(function, file)
            try:
                if root:
                    place._cache_path = os.path.join(root(), "numba", cls.get_suitable_cache_subpath(file))
                place.ensure_cache_path()
            except OSError:
                if root or not place._keeps(function, file):
                    continue
            return place
        return None

    def _keeps(self, function: Any, file: str) -> bool:
        """Return whether the function's code is here; of `njit`, the mark that all was compiled here."""
        python = "".join(map(str, sys.version_info[:2]))
        index = f"{Path(file).stem}.{function.__name__}-{function.__code__.co_firstlineno}.py{python}*.nbi"
        return any(Path(self.get_cache_path()).glob("compiled-*" if function is njit else index))


class _CacheFiles(caching.CompileResultCacheImpl):
    _locator_classes = [caching.UserProvidedCacheLocator, _Folder]  # noqa: RUF012  (numba's name)


class _CalledFiles(_CacheFiles):
    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        """Return the start of the files' names."""
        return f"{super().get_filename_base(fullname, abiflags)}-called"


class _KernelCache(caching.FunctionCache):
    _impl_class = _CacheFiles

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what was kept for types; None where there is none, or it names types that are no longer there."""
        try:
            return super().load_overload(sig, target_context)
        except (ImportError, AttributeError):
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep compiled code; a full disk is done without."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            note_unwritable(self.cache_path, error.strerror or str(error))
            self.disable()


class _CalledCache(_KernelCache):
    _impl_class = _CalledFiles


class _Called(_Compiled):
    """A function as compiled functions call it."""

    _files = _CalledCache

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Resolve a call from a compiled function: a constant is a number like others."""
        plain = {name: types.unliteral(kind) for name, kind in kws.items()}
        return super().get_call_template(tuple(types.unliteral(kind) for kind in args), plain)


class _Kernel(_Compiled):
    """A function as Python calls it."""

    _files = _KernelCache

    @cached_property
    def called(self) -> Any:
        """Return the function as compiled functions call it."""
        called = _Called(self.py_func, targetoptions=self.targetoptions | {"no_cpython_wrapper": True})
        called.enable_caching()
        return called

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Resolve a call from a compiled function."""
        return self.called.get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        """Return the function that such a call is of."""
        return self.called.get_overload(sig)
