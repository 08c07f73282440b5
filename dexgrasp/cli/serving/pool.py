"""Worker processes of a server: each handles one message at a time, and is replaced if it dies or takes too long."""

import asyncio
import os
import signal
import sys
import time
from asyncio.subprocess import Process
from collections import Counter
from contextlib import suppress
from multiprocessing import Pipe
from typing import Any

from dexgrasp.runs.messages import pack, unpack
from dexgrasp.runs.pool import THREADS
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError


class Refusal(Exception):  # noqa: N818  (an answer, not a fault)
    """Error line that a client is sent in place of an answer."""


class Worker:
    """Worker process, restarted where it died.

    Attributes:
        connections: number of connections that it serves.
        metadata: first message of the server, from the worker when it was ready.
    """

    def __init__(self, settings: Fields, seconds: float, counters: Counter[str]) -> None:
        self._settings, self._seconds, self._counters = settings, seconds, counters
        self._process: Process | None = None
        self._pipe: Any = None
        self._turn = asyncio.Lock()
        self.connections = 0
        self.metadata: Fields = {}

    async def start(self) -> None:
        """Start the process, and wait until its code is compiled and its weights are loaded.

        Raises:
            InputError: for settings that the worker cannot work with.
        """
        one = {name: os.environ.get(name, "1") for name in THREADS}
        self._pipe, theirs = Pipe()
        with theirs:
            end = theirs.fileno()
            self._process = await asyncio.create_subprocess_exec(
                sys.executable, "-m", "dexgrasp.cli.serving.worker", str(end), pass_fds=[end], stdout=2,
                start_new_session=True, env={**os.environ, **one},
            )  # fmt: skip
        try:
            counter, answer = await asyncio.to_thread(_exchange, self._pipe, self._settings)
        except (EOFError, OSError):
            raise InputError("a worker died while it started: see what it printed above") from None
        if counter:
            raise InputError(answer)
        self.metadata = unpack(answer)

    async def ask(self, connection: int, message: bytes) -> bytes:
        """Return the packed answer to a packed message.

        Raises:
            Refusal: for a mistake of the client, a fault, a worker that died, or one that took too long.
        """
        came = time.perf_counter()
        async with self._turn:
            try:
                if self._process is None or self._process.returncode is not None:
                    self._counters["restarts"] += 1
                    await self.start()
                frame = {"connection": connection, "waited": time.perf_counter() - came, "data": message}
                asked = asyncio.to_thread(_exchange, self._pipe, frame)
                counter, answer = await asyncio.wait_for(asked, self._seconds)
            except TimeoutError:
                self._counters["timeouts"] += 1
                self._kill()
                raise Refusal(f"no answer within {self._seconds:g} s: the request was stopped") from None
            except (EOFError, OSError):
                self._counters["deaths"] += 1
                self._kill()
                raise Refusal("the worker died while it answered; another one is started") from None
            except InputError as error:
                self._kill()
                raise Refusal(str(error)) from None
            except asyncio.CancelledError:  # its answer would be taken for that of the next message
                self._kill()
                raise
        if counter:
            self._counters[counter] += 1
            raise Refusal(answer)
        return answer

    async def forget(self, connection: int) -> None:
        """Tell the worker that a connection is closed."""
        async with self._turn:
            if self._process is not None and self._process.returncode is None:
                self._pipe.send_bytes(pack({"connection": connection, "waited": 0.0, "data": None}))

    async def stop(self) -> None:
        """End the process once it has answered."""
        async with self._turn:
            if self._process is not None:
                self._pipe.close()
                try:
                    await asyncio.wait_for(self._process.wait(), 5.0)
                except TimeoutError:
                    self._kill()

    def _kill(self) -> None:
        process, self._process = self._process, None
        if process is not None and process.returncode is None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # the leader of its session


def _exchange(pipe: Any, frame: Fields) -> tuple[str, Any]:
    """Send a frame to a worker; return what it says: "" and bytes, or a counter and the line of an error."""
    pipe.send_bytes(pack(frame))
    said = unpack(pipe.recv_bytes())
    return said["counter"], said["answer"]
