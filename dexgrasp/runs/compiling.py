"""Compiling ahead: what a rehearsal calls is compiled by several processes at once and kept on disk.

On a machine where nothing is compiled yet, every function would wait for the one before it. A rehearsal runs the same
work with all of them left in Python, in a process of its own, and takes down the types that they are called with; then
they are compiled, those that are called before those that call them. Whatever a rehearsal does not reach is compiled at
its first call, as ever.
"""

import importlib
import inspect
import os
import tempfile
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import suppress
from functools import cache, partial
from graphlib import TopologicalSorter
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.core.registry import cpu_target
from numba.core.typing.templates import fold_arguments

from dexgrasp.runs.pool import WorkerDiedError, processes
from dexgrasp.runs.progress import Show, progress_bar
from dexgrasp_env import __version__, compiled
from dexgrasp_env.arrays import Fields
from dexgrasp_env.compiled import njit
from dexgrasp_env.extras import usable_cores
from dexgrasp_env.files import content_hash, lock

_MOST_WORKERS = 8
_LOOK = 1.0  # s between two looks at how far they are
_LISTENED = 20  # calls of a function whose types are looked at; they hardly change


class Task(NamedTuple):
    """A function to compile for types that a rehearsal has called it with."""

    module: str
    name: str
    kinds: tuple[Any, ...]  # numba's, one an argument
    calls: frozenset[str]  # compiled functions, which have to be there before


@cache
def ensure_compiled(rehearsal: str = "dexgrasp.planning.rehearsal:rehearse") -> None:
    """Compile what a rehearsal calls, unless that has been done on this machine.

    One process does it, others that ask wait for it. Where numba's cache cannot be written, nothing is done.

    Args:
        rehearsal: a function without arguments, as "module:function". The module is imported by another process.
    """
    if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        return
    machine = cpu_target.target_context.codegen().magic_tuple()
    done = _cache_folder() / f"compiled-{content_hash(rehearsal, __version__, numba.__version__, machine)}"
    with suppress(OSError, WorkerDiedError):  # what is not compiled now is compiled at its first call
        if done.exists():
            return
        done.parent.mkdir(parents=True, exist_ok=True)
        with open(done.with_suffix(".lock"), "wb") as file:
            lock(file)
            if not done.exists():
                with progress_bar("function", "compiling, once on this machine") as show:
                    compile_ahead(rehearsal, show)
                done.touch()


def _cache_folder() -> Path:
    """Return where numba keeps what it compiles of this folder."""

    @njit
    def nothing() -> None:
        """Do nothing; where numba would keep it is all that is asked."""

    return Path(nothing.stats.cache_path)  # type: ignore[attr-defined]


def compile_ahead(rehearsal: str, show: Show, workers: int | None = None) -> list[Task]:
    """Compile what a rehearsal calls.

    Args:
        rehearsal: see `ensure_compiled`.
        show: called with how many functions are compiled, of how many.
        workers: processes that compile; one a processor by default.

    Returns:
        What was compiled.

    Raises:
        OSError: if no process can be started.
        WorkerDiedError: if one went away.
    """
    workers = workers or min(_MOST_WORKERS, usable_cores())
    with processes(workers, alone=True) as pool:
        for _ in range(workers):
            pool.submit(_prepare, rehearsal)
        with processes(1, alone=True) as stage:
            tasks = stage.submit(_rehearse, rehearsal).result()
        order = TopologicalSorter(
            {task: [one for one in tasks[:k] if one.name in task.calls] for k, task in enumerate(tasks)}
        )
        order.prepare()
        sent, done = dict[Future[None], Task](), 0
        while order.is_active():
            sent |= {pool.submit(_compile, task): task for task in order.get_ready()}
            ended, waiting = wait(sent, _LOOK, FIRST_COMPLETED)
            order.done(*map(sent.pop, ended))
            done += len(ended)
            show(done, len(tasks), now=" ".join(sent[one].name for one in waiting if one.running()))
    return tasks


def _prepare(rehearsal: str) -> None:
    """Import what is compiled."""
    importlib.import_module(rehearsal.partition(":")[0])


def _rehearse(rehearsal: str) -> list[Task]:
    """Run a rehearsal in Python, as far as it goes; return what was called, the innermost first."""
    heard = list[Task]()
    compiled.stand_in = partial(_Rehearsed, heard)
    module, _, function = rehearsal.partition(":")
    with tempfile.TemporaryDirectory(prefix="dexgrasp-rehearsal-") as folder, suppress(Exception):
        os.environ["DEXGRASP_CACHE"] = folder
        getattr(importlib.import_module(module), function)()
    return heard


def _compile(task: Task) -> None:
    """Compile one function; an error is said by the call that needs it."""
    kernel = getattr(importlib.import_module(task.module), task.name)
    if inspect.isfunction(kernel):  # compiled where it is used, under another name
        kernel = njit(kernel)
    with suppress(Exception):
        kernel.compile(task.kinds)


class _Rehearsed:
    """A function that would be compiled, run by Python instead."""

    def __init__(self, heard: list[Task], function: Callable[..., Any], inline: str = "never") -> None:
        self._heard, self.function, self._inline = heard, function, inline != "never"
        self._signature = inspect.signature(function)
        self._known = set[tuple[Any, ...]]()
        self._count = 0

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Run the function; its types are taken down when it returns, after those of the functions that it calls."""
        self._count += 1
        kinds = self._kinds(args, kwargs) if self._count <= _LISTENED and not self._inline else None
        try:
            return self.function(*map(_with_fields, args), **kwargs)
        finally:
            if kinds is not None and kinds not in self._known:
                self._known.add(kinds)
                self._heard.append(
                    Task(self.function.__module__, self.function.__name__, kinds, frozenset(self.calls()))
                )

    def _kinds(self, args: tuple[Any, ...], kwargs: Fields) -> tuple[Any, ...]:
        """Return the types of a call as numba sees them."""
        return fold_arguments(
            self._signature, args, kwargs, lambda _, __, value: numba.typeof(value),
            lambda _, __, default: numba.types.Omitted(default), None,
        )  # fmt: skip

    def calls(self) -> set[str]:
        """Return the names of the compiled functions that this one calls, and those call, and so on."""
        found = map(self.function.__globals__.get, self.function.__code__.co_names)
        others = [other for other in found if isinstance(other, _Rehearsed) and other is not self]
        return {other.function.__name__ for other in others}.union(*(other.calls() for other in others))


def _with_fields(value: Any) -> Any:
    """Let the fields of records be attributes, as compiled code has it."""
    records = isinstance(value, np.ndarray) and value.dtype.names is not None
    return value.view(np.recarray) if records else value
