"""Work in parallel: in processes of this machine, or on a Ray cluster. What comes out does not depend on which."""

import logging
import multiprocessing
import os
import pickle
import socket
import sys
import threading
from collections.abc import Callable, Iterator, MutableMapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing import connection
from types import ModuleType
from typing import Annotated, Any, TypeVar

from dexgrasp.runs.interrupt import not_inherited
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import require_extra
from dexgrasp_env.valid import Count, check, one_of

T = TypeVar("T")
R = TypeVar("R")

BACKENDS = ("processes", "ray")
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_AHEAD = 4
"""Tasks in flight for each processor of a cluster: enough that none waits for the driver."""
_RETRIES = 10
"""Lost nodes of a cluster that a task may outlive."""


class WorkerDiedError(RuntimeError):
    """A worker process was killed or crashed."""


@dataclass(frozen=True)
class Backend:
    """Where it runs; what comes out does not depend on it.

    Attributes:
        name: processes of this machine, or ray, tasks on a cluster.
        workers: processes; with 1 everything runs in this one.
        address: with ray the cluster, auto or host:port (default: a new one here, of so many workers).
    """

    name: Annotated[str, one_of(BACKENDS), "--backend"] = "processes"
    workers: Annotated[Count, "W"] = 1
    address: Annotated[str | None, "A"] = None

    def __post_init__(self) -> None:
        """Check the name, and what no field alone can be wrong in.

        Raises:
            InputError: for an unknown name, an address without Ray, or Ray without its extra.
        """
        check("backend", self.name, one_of(BACKENDS))
        if self.address is not None and self.name != "ray":
            raise InputError("--address is of a Ray cluster: add --backend ray")
        if self.name == "ray":
            require_extra("cluster", "backend 'ray'")


def run_pool(work: Callable[[T], R], tasks: Sequence[T], backend: Backend) -> Iterator[R]:
    """Yield what `work` makes of each task, in the order in which they are finished.

    Args:
        work: with one worker it is called itself; every other process keeps a copy, which pickle makes, for all of its
            tasks. Must give the same wherever and whenever it runs.
        tasks: its arguments, small.
        backend: where.

    Raises:
        InputError: where no cluster answers.
        WorkerDiedError: if a process went away.
        Exception: whatever `work` raises.
    """
    workers = max(1, min(backend.workers, len(tasks)))
    if backend.name == "ray":
        yield from _on_cluster(pickle.dumps(work), tasks, backend.address, workers)
    elif workers == 1:
        for task in tasks:  # a StopIteration of a task would end a map() as if all were done
            yield work(task)
    else:
        yield from _in_processes(pickle.dumps(work), tasks, workers)


@contextmanager
def processes(workers: int, *, alone: bool = False) -> Iterator[ProcessPoolExecutor]:
    """Have new processes at work, which end with the block or with this process.

    Args:
        workers: how many.
        alone: they do not import the main module: a script that does not ask for its name would run in each of them.

    Raises:
        WorkerDiedError: if one went away.
    """
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _begin)
    main = {"__main__": ModuleType("__main__")} if alone else {}
    share = str(max(1, (os.cpu_count() or 1) // workers))  # of the processors, that each may use
    limits = {name: os.environ.get(name, share) for name in _THREADS}
    try:
        with _replaced(os.environ, limits), _replaced(sys.modules, main), not_inherited():
            pool.submit(os.getpid)  # starts all of them
        yield pool
    except BrokenProcessPool:
        raise WorkerDiedError(
            "a worker process died (killed, out of memory, or a crash in native code)"
        ) from None
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()


def _in_processes(packed: bytes, tasks: Sequence[Any], workers: int) -> Iterator[Any]:
    waiting = set[Future[Any]]()
    with processes(workers) as pool:
        for number, task in enumerate(tasks, start=1):
            waiting.add(pool.submit(_do, packed, task))
            while waiting and (len(waiting) >= 2 * workers or number == len(tasks)):
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                yield from (
                    future.result() for future in sorted(done, key=lambda own: own.exception() is not None)
                )


def _on_cluster(packed: bytes, tasks: Sequence[Any], address: str | None, workers: int) -> Iterator[Any]:
    """Yield what comes of tasks on a Ray cluster, one a piece; Ray runs again what a lost node had not finished.

    Args:
        packed: sent once.
        tasks: in flight are `_AHEAD` for each processor; they are cancelled where one raises.
        address: of a running cluster: "auto" for the one that this machine belongs to, or host:port; None for the
            cluster that is connected already, else a new one on this machine alone.
        workers: processes of a new cluster.

    Raises:
        InputError: where no cluster answers.
    """
    import ray

    connected = _connect(address, workers)
    remote = ray.remote(_do).options(num_cpus=1, max_retries=_RETRIES)
    sent = ray.put(packed)
    most = _AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1)))
    waiting = list[Any]()
    try:
        for number, task in enumerate(tasks, start=1):
            waiting.append(remote.remote(sent, task))
            while waiting and (len(waiting) >= most or number == len(tasks)):
                done, waiting = ray.wait(waiting)
                yield from map(_result, done)
    finally:
        for reference in waiting:
            ray.cancel(reference, force=True)
        if connected:
            ray.shutdown()


def _result(reference: Any) -> Any:
    import ray
    from ray.exceptions import RayTaskError

    try:
        return ray.get(reference)
    except RayTaskError as error:
        raise error.cause if isinstance(error.cause, InputError) else error from None


def _connect(address: str | None, workers: int) -> bool:
    """Connect to a cluster; return whether it was this call that did."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is sent anywhere
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    import ray

    if address is None and ray.is_initialized():
        return False
    if address not in (None, "auto"):
        host, _, port = str(address).removeprefix("ray://").rpartition(":")
        try:  # Ray itself waits for minutes where nobody listens
            socket.create_connection((host, int(port)), timeout=5.0).close()
        except (OSError, ValueError) as error:
            raise _no_cluster(address, getattr(error, "strerror", None) or str(error)) from None
    local: Fields = {} if address else {"num_cpus": workers, "include_dashboard": False}
    try:
        ray.init(address=address or "local", log_to_driver=False, logging_level=logging.ERROR, **local)
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise _no_cluster(address, str(error).partition("\n")[0]) from None
    return True


def _no_cluster(address: str | None, reason: str) -> InputError:
    return InputError(
        f"no Ray cluster at {address!r}: {reason} (valid: auto, on a machine of it, or host:port)"
    )


def _do(packed: bytes, task: Any) -> Any:
    return _unpacked(packed)(task)


@lru_cache(maxsize=1)
def _unpacked(packed: bytes) -> Callable[[Any], Any]:
    """Return this process's copy of what does the work; `packed` is of the process that started it."""
    return pickle.loads(packed)


def _begin() -> None:
    """Prepare a worker."""
    from tqdm import tqdm

    # The lock that bars have of themselves is a semaphore, which a process that is terminated leaves behind.
    tqdm.set_lock(threading.RLock())
    _end_with_parent()


def _end_with_parent() -> None:
    """End this process soon after the one that started it is gone, even if that is killed: there is nothing to do."""

    def watch() -> None:
        """Wait for the end of the parent, and end."""
        parent = multiprocessing.parent_process()
        if parent is not None:
            connection.wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _replaced(mapping: MutableMapping[str, T], entries: dict[str, T]) -> Iterator[None]:
    """Set entries for the processes that start meanwhile."""
    before = {name: mapping[name] for name in entries if name in mapping}
    mapping.update(entries)
    try:
        yield
    finally:
        for name in entries:
            del mapping[name]
        mapping.update(before)
