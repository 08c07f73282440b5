"""The server: WebSocket connections, each with a worker, until a signal ends it.

The server sends the first message of a connection: its version and what it serves. Then it answers each message of the
client with one: bytes (msgpack) are an answer, text is an error in one line, as the package `openpi-client` expects.
"""

import asyncio
import hmac
import json
import signal
import socket
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from http import HTTPStatus
from itertools import count
from typing import Annotated, Any

from dexgrasp.cli.serving.pool import Refusal, Worker
from dexgrasp.runs.messages import pack
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import Count, Positive, number


@dataclass(frozen=True, kw_only=True)
class ServerSettings:
    """The server.

    Attributes:
        host: address that it listens at; 0.0.0.0 is every network of this machine.
        port: that it listens at; 0 takes a free one.
        workers: processes that answer (default: one a core).
        connections: at most, at a time; more are refused with 503.
        seconds: that an answer may take, at most.
        megabytes: of a message, at most; the connection that sends a larger one is closed.
    """

    host: str = "127.0.0.1"
    port: Annotated[int, number(ge=0, le=65535, whole=True)] = 8000
    workers: Annotated[Count | None, "W"] = None
    connections: Count = 64
    seconds: Positive = 60.0
    megabytes: Positive = 64.0


class Server:
    """Connections and workers of a server."""

    def __init__(self, settings: ServerSettings, workers: int, served: Fields, token: str | None) -> None:
        """Prepare; `run` starts it.

        Args:
            settings: address and limits.
            workers: number of processes.
            served: names of `agent` and `robot`, or None.
            token: that clients must send as `Authorization: Api-Key TOKEN`; None asks for none.
        """
        self._settings, self._token = settings, token
        kinds = "connections", "requests", "errors", "refused", "faults", "timeouts", "deaths", "restarts"
        self.counters = Counter(dict.fromkeys(kinds, 0))
        self._workers = [Worker(served, settings.seconds, self.counters) for _ in range(workers)]
        self._numbers, self._open, self._in_hand = count(1), set[Any](), 0
        self._stopping = asyncio.Event()
        self._idle = asyncio.Event()
        self._idle.set()

    async def run(self, ready: Callable[[int, Fields], None]) -> None:
        """Serve until SIGTERM or SIGINT; messages in progress are still answered.

        Args:
            ready: called with the port and the first message once all workers are ready.

        Raises:
            InputError: for an address that cannot be listened at, or settings that no worker can work with.
        """
        from websockets.asyncio.server import serve

        loop = asyncio.get_running_loop()
        # A thread for each worker, in which its answer is waited for.
        loop.set_default_executor(ThreadPoolExecutor(len(self._workers)))
        for number_ in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number_, self._stopping.set)
        place = _bound(self._settings)  # an address that is taken is said before anything is loaded
        try:
            await asyncio.gather(*(worker.start() for worker in self._workers))
            listening = await serve(
                self._connection,
                sock=place,
                process_request=self._request,
                origins=[None],  # pages of a browser send their origin
                compression=None,
                max_size=int(self._settings.megabytes * 1e6),
                max_queue=2,
            )
            ready(place.getsockname()[1], self._workers[0].metadata)
            await self._stopping.wait()
            listening.close(close_connections=False)
            await self._idle.wait()
            # The close code of a server that goes away.
            await asyncio.gather(*(client.close(1001, "the server ends") for client in self._open))
            await listening.wait_closed()
        finally:
            place.close()
            await asyncio.gather(*(worker.stop() for worker in self._workers))

    async def _connection(self, client: Any) -> None:
        from websockets.exceptions import ConnectionClosed

        worker, own = min(self._workers, key=lambda one: one.connections), next(self._numbers)
        worker.connections += 1
        self._open.add(client)
        self.counters["connections"] += 1
        try:
            await client.send(pack(worker.metadata))
            async for message in client:
                await self._answer(client, worker, own, message)
        except ConnectionClosed:
            pass
        finally:
            worker.connections -= 1
            self._open.discard(client)
            with suppress(OSError):
                await worker.forget(own)

    async def _answer(self, client: Any, worker: Worker, own: int, message: str | bytes) -> None:
        self.counters["requests"] += 1
        self._in_hand += 1
        self._idle.clear()
        try:
            if isinstance(message, str):
                raise Refusal("text is no message: send msgpack, as bytes")
            if self._stopping.is_set():
                raise Refusal("the server ends")
            await client.send(await worker.ask(own, message))
        except Refusal as refusal:
            self.counters["errors"] += 1
            await client.send(str(refusal))
        finally:
            self._in_hand -= 1
            if not self._in_hand:
                self._idle.set()

    def _request(self, connection: Any, request: Any) -> Any:
        """Answer plain HTTP requests; refuse a client without the token, or when all connections are taken."""
        if request.path == "/healthz":
            return connection.respond(HTTPStatus.OK, "ok\n")
        asked = request.headers.get("Authorization", "")
        if self._token is not None and not hmac.compare_digest(
            asked.encode(), f"Api-Key {self._token}".encode()
        ):
            return connection.respond(HTTPStatus.UNAUTHORIZED, "send Authorization: Api-Key TOKEN\n")
        if request.path == "/metrics":
            figures = {**self.counters, "open": len(self._open), "in_hand": self._in_hand}
            return connection.respond(HTTPStatus.OK, json.dumps(figures) + "\n")
        if len(self._open) >= self._settings.connections:
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, "all connections are taken\n")
        return None


def _bound(settings: ServerSettings) -> socket.socket:
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    try:
        return socket.create_server((settings.host, settings.port), family=family)
    except OSError as error:
        raise InputError(
            f"cannot listen at {settings.host}:{settings.port}: {error.strerror or error}"
        ) from None
