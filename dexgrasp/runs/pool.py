"""Work in parallel: in processes of this machine, or on a Ray cluster. What comes out does not depend on which."""

import logging
import os
import pickle
import socket
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing import resource_tracker
from typing import Annotated, Any, TypeVar

from dexgrasp.runs.interrupt import not_inherited
from dexgrasp_env.arrays import Fields
from dexgrasp_env.cores import usable_cores
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import require_extra
from dexgrasp_env.valid import Count, check, one_of

T = TypeVar("T")
R = TypeVar("R")

BACKENDS = ("processes", "ray")
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Variables that say how many threads a library takes."""


class WorkerDiedError(RuntimeError):
    """A worker process was killed or crashed."""


@dataclass(frozen=True)
class Backend:
    """Backend of workers; results do not depend on it.

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
        work: with one worker it is called itself; every other process keeps a copy for all of its
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
        yield from _on_cluster(_packed(work), tasks, backend.address, workers)
    elif workers == 1:
        for task in tasks:  # a StopIteration of a task would end a map() as if all were done
            yield work(task)
    else:
        yield from _in_processes(_packed(work), tasks, workers)


def _in_processes(packed: bytes, tasks: Sequence[Any], workers: int) -> Iterator[Any]:
    """Yield what comes of tasks in new processes, which never import the main module: a script runs once."""
    from loky import ProcessPoolExecutor

    share = str(max(1, usable_cores() // workers))  # of the processors, that each may use
    limits = {name: os.environ.get(name, share) for name in THREADS}
    # Of loky alone: the libraries that a worker loads are no leak.
    warnings.filterwarnings("ignore", "A worker was restarted", UserWarning, r"loky\.")
    pool = ProcessPoolExecutor(workers, initializer=_begin, initargs=(os.getpid(),), env=limits)
    waiting = set[Future[Any]]()
    resource_tracker.ensure_running()  # its start lets signals through again
    try:
        with not_inherited():  # the first task starts all workers, and the thread that replaces one
            pool.submit(os.getpid)
        for number, task in enumerate(tasks, start=1):
            waiting.add(pool.submit(_do, packed, task))
            while waiting and (len(waiting) >= 2 * workers or number == len(tasks)):
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                yield from (
                    future.result() for future in sorted(done, key=lambda own: own.exception() is not None)
                )
    except BrokenProcessPool:
        raise WorkerDiedError(
            "a worker process died (killed, out of memory, or a crash in native code)"
        ) from None
    finally:
        pool.shutdown(kill_workers=True)


def _on_cluster(packed: bytes, tasks: Sequence[Any], address: str | None, workers: int) -> Iterator[Any]:
    """Yield what comes of tasks on a Ray cluster, one a piece; Ray runs again what a lost node had not finished.

    Args:
        packed: sent once.
        tasks: in flight are four for each processor, so that none waits for the driver; cancelled where one raises.
        address: of a running cluster: "auto" for the one that this machine belongs to, or host:port; None for the
            cluster that is connected already, else a new one on this machine alone.
        workers: processes of a new cluster.

    Raises:
        InputError: where no cluster answers.
    """
    import ray

    connected = _connect(address, workers)
    remote = ray.remote(_do).options(num_cpus=1, max_retries=10)  # lost nodes that a task may outlive
    sent = ray.put(packed)
    most = 4 * max(1, int(ray.cluster_resources().get("CPU", 1)))
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


def _packed(work: Callable[[Any], Any]) -> bytes:
    """Return work as bytes; what is of the main module, which no other process has, travels with it."""
    import cloudpickle  # loky and Ray bring it

    packed: bytes = cloudpickle.dumps(work)
    return packed


def _do(packed: bytes, task: Any) -> Any:
    return _unpacked(packed)(task)


@lru_cache(maxsize=1)
def _unpacked(packed: bytes) -> Callable[[Any], Any]:
    """Return this process's copy of what does the work; `packed` is of the process that started it."""
    return pickle.loads(packed)


def _begin(parent: int) -> None:
    """Prepare a worker of a process."""
    from tqdm import tqdm

    # The lock that bars have of themselves is a semaphore, which a process that is terminated leaves behind.
    tqdm.set_lock(threading.RLock())

    def end_with_parent() -> None:
        """End soon after the parent is gone, even if that is killed: there is nothing to do."""
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
