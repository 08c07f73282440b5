"""Worker processes of a server: each handles one message at a time, and is replaced if it dies or takes too long."""

import asyncio
import os
import signal
import sys
import time
from asyncio.subprocess import PIPE, Process
from collections import Counter
from contextlib import suppress

from dexgrasp.cli.serving.worker import ANSWER, CLOSED, HEAD, MESSAGE, REFUSED, SIZE
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
        self._turn = asyncio.Lock()
        self.connections = 0
        self.metadata: Fields = {}

    async def start(self) -> None:
        """Start the process, and wait until its code is compiled and its weights are loaded.

        Raises:
            InputError: for settings that the worker cannot work with.
        """
        one = {name: os.environ.get(name, "1") for name in THREADS}
        self._process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "dexgrasp.cli.serving.worker",
            stdin=PIPE,
            stdout=PIPE,
            start_new_session=True,
            env={**os.environ, **one},
        )
        try:
            kind, data = await self._exchange(MESSAGE, 0, pack(self._settings))
        except (asyncio.IncompleteReadError, OSError):
            raise InputError("a worker died while it started: see what it printed above") from None
        if kind != ANSWER:
            raise InputError(data.decode())
        self.metadata = unpack(data)

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
                waited = time.perf_counter() - came
                kind, data = await asyncio.wait_for(
                    self._exchange(MESSAGE, connection, message, waited), self._seconds
                )
            except TimeoutError:
                self._counters["timeouts"] += 1
                self._kill()
                raise Refusal(f"no answer within {self._seconds:g} s: the request was stopped") from None
            except (asyncio.IncompleteReadError, OSError):
                self._counters["deaths"] += 1
                self._kill()
                raise Refusal("the worker died while it answered; another one is started") from None
            except InputError as error:
                self._kill()
                raise Refusal(str(error)) from None
            except asyncio.CancelledError:  # its answer would be taken for that of the next message
                self._kill()
                raise
        if kind != ANSWER:
            self._counters["refused" if kind == REFUSED else "faults"] += 1
            raise Refusal(data.decode())
        return data

    async def forget(self, connection: int) -> None:
        """Tell the worker that a connection is closed."""
        async with self._turn:
            if self._process is not None and self._process.returncode is None and self._process.stdin:
                self._process.stdin.write(HEAD.pack(0, CLOSED, connection, 0.0))

    async def stop(self) -> None:
        """End the process once it has answered."""
        async with self._turn:
            if self._process is not None and self._process.stdin:
                self._process.stdin.close()
                try:
                    await asyncio.wait_for(self._process.wait(), 5.0)
                except TimeoutError:
                    self._kill()

    async def _exchange(
        self, kind: int, connection: int, data: bytes, waited: float = 0.0
    ) -> tuple[int, bytes]:
        process = self._process
        assert process is not None and process.stdin is not None and process.stdout is not None
        process.stdin.write(HEAD.pack(len(data), kind, connection, waited))
        process.stdin.write(data)
        await process.stdin.drain()
        size, answer = SIZE.unpack(await process.stdout.readexactly(SIZE.size))
        return answer, await process.stdout.readexactly(size)

    def _kill(self) -> None:
        process, self._process = self._process, None
        if process is not None and process.returncode is None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # the leader of its session
