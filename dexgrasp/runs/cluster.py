"""Work on a Ray cluster, one task a piece; Ray schedules, and runs again what a lost node had not finished."""

import logging
import os
import socket
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar

from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError

T = TypeVar("T")
R = TypeVar("R")

_AHEAD = 4
"""Tasks in flight for each processor of the cluster: enough that none waits for the driver."""
_RETRIES = 10
"""Lost nodes that a task may outlive."""


def run_on_cluster(
    do: Callable[[bytes, T], R], packed: bytes, tasks: Iterable[T], address: str | None, workers: int
) -> Iterator[R]:
    """Yield what `do(packed, task)` makes of each task, in the order in which they are finished.

    Args:
        do: at the top of a module that every node has; must give the same whenever and wherever it runs.
        packed: what every task is given; sent once.
        tasks: small.
        address: of a running cluster: "auto" for the one that this machine belongs to, or host:port; None for the
            cluster that is connected already, else a new one on this machine alone.
        workers: processes of a new cluster.

    Raises:
        InputError: where no cluster answers.
        Exception: whatever the function raises; tasks in flight are cancelled then.
    """
    import ray

    connected = _connect(address, workers)
    remote = ray.remote(do).options(num_cpus=1, max_retries=_RETRIES)
    sent = ray.put(packed)
    most = _AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1)))
    waiting: list[Any] = []
    try:
        for task in tasks:
            waiting.append(remote.remote(sent, task))
            if len(waiting) >= most:
                done, waiting = ray.wait(waiting)
                yield from map(_result, done)
        while waiting:
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
        _check_reachable(str(address))
    local: Fields = {} if address else {"num_cpus": workers, "include_dashboard": False}
    try:
        ray.init(address=address or "local", log_to_driver=False, logging_level=logging.ERROR, **local)
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise _no_cluster(address, str(error).partition("\n")[0]) from None
    return True


def _check_reachable(address: str) -> None:
    """Knock first: Ray itself waits for minutes where nobody listens."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    try:
        socket.create_connection((host, int(port)), timeout=5.0).close()
    except (OSError, ValueError) as error:
        raise _no_cluster(address, getattr(error, "strerror", None) or str(error)) from None


def _no_cluster(address: str | None, reason: str) -> InputError:
    return InputError(
        f"no Ray cluster at {address!r}: {reason} (valid: auto, on a machine of it, or host:port)"
    )
