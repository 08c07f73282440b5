"""Trials in several processes; what comes out does not depend on how many."""

import multiprocessing
import os
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import lru_cache
from multiprocessing import connection
from typing import Any, NamedTuple

from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.evaluation.spec import TrialSpec
from dexgrasp.evaluation.trial_runner import TrialRunner, thread_limits
from dexgrasp.runs.cluster import run_on_cluster
from dexgrasp.runs.interrupt import not_inherited
from dexgrasp_env.errors import InputError

Finished = tuple[dict[str, Any], dict[str, Any] | None]
"""A line of trials.jsonl, and the grasp."""

_bench: TrialRunner | None = None


class Backend(NamedTuple):
    """Where trials run: processes of this machine, or tasks of a Ray cluster.

    Attributes:
        name: "processes" or "ray".
        workers: processes; with 1 everything runs in this one. Of a new Ray cluster where no address is given.
        address: of the cluster: "auto" or host:port; None for a new one on this machine.
    """

    name: str = "processes"
    workers: int = 1
    address: str | None = None


BACKENDS = ("processes", "ray")


class WorkerDiedError(RuntimeError):
    """A worker process was killed or crashed."""


class LostTrialsError(RuntimeError):
    """Fewer trials finished than were asked for, though nothing said so."""


def run_cells(
    settings: EvaluationSettings, cells: Sequence[TrialSpec], backend: Backend, bench: TrialRunner
) -> Iterator[Finished]:
    """Yield rows and grasps of the cells as they are finished.

    Args:
        settings: of the evaluation.
        cells: the trials.
        backend: where they run.
        bench: used with one worker.

    Raises:
        InputError: without Ray, its cluster, or where a node of it has other code or files.
        WorkerDiedError: if a process went away.
    """
    workers = min(backend.workers, len(cells))
    if backend.name == "ray":
        identity = settings.identity()
        tasks = (_Task(settings, _frozen(identity), cell) for cell in cells)
        yield from run_on_cluster(_run_on_node, tasks, address=backend.address, workers=max(1, workers))
        return
    if workers <= 1:
        for cell in cells:  # a StopIteration of a trial would end a map() as if all were done
            yield bench.run(cell)
        return
    context = multiprocessing.get_context("spawn")
    with _environment(thread_limits(workers)):
        pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_start, initargs=(settings,))
        try:
            yield from _as_finished(pool, cells, ahead=2 * workers)
        except BrokenProcessPool:
            raise WorkerDiedError(
                "a worker process died (killed, out of memory, or a crash in native code)"
            ) from None
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                child.terminate()


def _as_finished(pool: ProcessPoolExecutor, cells: Sequence[TrialSpec], ahead: int) -> Iterator[Finished]:
    waiting: set[Future[Finished]] = set()
    for cell in cells:
        with not_inherited():  # submitting starts the processes
            waiting.add(pool.submit(_run, cell))
        if len(waiting) >= ahead:
            done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            yield from (future.result() for future in done)
    while waiting:
        done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
        yield from (future.result() for future in done)


def _start(settings: EvaluationSettings) -> None:
    """Set a worker up: without a parent there is nothing to do."""
    global _bench
    threading.Thread(target=_exit_with_parent, daemon=True).start()
    _bench = TrialRunner(settings)


def _exit_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def _run(cell: TrialSpec) -> Finished:
    assert _bench is not None, "the initializer has run"
    return _bench.run(cell)


class _Task(NamedTuple):
    settings: EvaluationSettings
    identity: tuple[tuple[str, str], ...]
    cell: TrialSpec


def _run_on_node(task: _Task) -> Finished:
    """Run a trial on a node of a cluster; each of its processes keeps its agents and environments."""
    return _node_runner(task.settings, task.identity).run(task.cell)


@lru_cache(maxsize=1)
def _node_runner(settings: EvaluationSettings, identity: tuple[tuple[str, str], ...]) -> TrialRunner:
    here = dict(_frozen(settings.identity()))
    if other := [key for key, value in identity if here.get(key) != value]:
        raise InputError(
            f"a node of the cluster has other {', '.join(other)} than this machine: install the same dexgrasp there, "
            "and give meshes and checkpoints by paths that every node has"
        )
    return TrialRunner(settings)


def _frozen(identity: dict[str, Any]) -> tuple[tuple[str, str], ...]:
    return tuple((key, repr(value)) for key, value in identity.items())


@contextmanager
def _environment(variables: dict[str, str]) -> Iterator[None]:
    """Set environment variables for the processes that start meanwhile."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
