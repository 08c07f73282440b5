"""Work in parallel: processes of joblib, threads, or a cluster through Ray."""

import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from typing import Any

from dexgrasp.runs.cluster import run_on_cluster
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import require_extra

BACKENDS = ("loky", "threading", "ray")


def check_backend(backend: str) -> None:
    """Check the name of a backend.

    Raises:
        InputError: for an unknown one, or ray without its extra.
    """
    if backend not in BACKENDS:
        raise InputError(f"backend {backend!r}: valid are {', '.join(BACKENDS)}")
    if backend == "ray":
        require_extra("cluster", "backend 'ray'")


def run_jobs(
    work: Callable[..., None], jobs: Sequence[Any], common: tuple[Any, ...], workers: int, backend: str,
    address: str | None = None,
) -> Iterator[None]:  # fmt: skip
    """Call `work(job, *common)` for every job, in any order; yield as each is done.

    Args:
        work: a function of a module; it leaves its results in files.
        jobs: what to call it with.
        common: what every call is given.
        workers: processes; with 1 of loky everything runs in this one.
        backend: one of `BACKENDS`.
        address: of the cluster, "auto" or host:port; None for a new one on this machine.
    """
    if backend == "ray":
        tasks = ((work, job, common) for job in jobs)
        yield from run_on_cluster(_work_on_node, tasks, address=address, workers=workers)
        return
    if workers == 1 and backend == "loky":
        for job in jobs:
            work(job, *common)
            yield
        return
    yield from _parallel(work, jobs, common, workers, backend)


def _parallel(
    work: Callable[..., None], jobs: Sequence[Any], common: tuple[Any, ...], workers: int, backend: str
) -> Iterable[None]:
    from joblib import Parallel, delayed

    calls = [delayed(_work_below)(os.getpid(), work, job, common) for job in jobs]
    return Parallel(n_jobs=workers, backend=backend, batch_size=1, return_as="generator_unordered")(calls)


def _work_on_node(task: tuple[Callable[..., None], Any, tuple[Any, ...]]) -> None:
    work, job, common = task
    work(job, *common)


def _work_below(parent: int, work: Callable[..., None], job: Any, common: tuple[Any, ...]) -> None:
    """Do one job; a process that `parent` started ends with it, even if that is killed."""
    if os.getppid() == parent:
        _end_with(parent)
    work(job, *common)


@cache
def _end_with(parent: int) -> None:
    """End this process soon after its parent is gone."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
