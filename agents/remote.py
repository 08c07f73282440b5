"""Policies of another process or machine: `ws://HOST:PORT` as an agent, in the protocol of `openpi-client`.

Each connection has an episode of its own. The first observation of an episode comes with `reset`, the agent's `seed`
and the `info` of the environment's reset; the answer's `actions` (H, n) are carried out before the next is asked for.
"""

import os
import time
from contextlib import suppress
from typing import Any
from urllib.parse import parse_qs, urlsplit

import gymnasium as gym
import numpy as np

from dexgrasp.agent import Agent, Info, Observation, Report
from dexgrasp.evaluation.protocol import AGENT_KEYS
from dexgrasp.evaluation.store import SERVER_GONE
from dexgrasp.runs.messages import pack, unpack
from dexgrasp_env.arrays import Array, Fields, Single
from dexgrasp_env.errors import InputError, first_line
from dexgrasp_env.extras import require_extra
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.valid import check, instance, read


class RemoteAgent(Agent):
    """A policy server as an agent; what goes wrong with it fails the trial with a reason.

    Reasons are `server_gone` (no connection within 5 s, or one that broke), `server_slow`, `server_error` and
    `bad_answer`; `report.details["server"]` has the words.

    Attributes:
        metadata: what the server says of itself.
    """

    def __init__(self, name: str) -> None:
        """Connect to `ws://HOST:PORT`, `?timeout=S` behind it for the seconds that an answer may take.

        Raises:
            InputError: for an address that is none, or where no policy answers.
        """
        require_extra("serve", f"agent {name!r}")
        self._address, self._seconds = _parsed(name)
        self._socket: Any = None
        self._left: list[Single] = []
        self._begin: Fields = {}
        self._seed = 0
        try:
            self._connect()
        except InputError as error:
            raise InputError(f"no policy server at {self._address}: {error}") from None
        rule = instance(dict, f"a mapping of {', '.join(AGENT_KEYS)}")
        given = self.metadata.get("env_settings", {})
        self.env_settings = check(f"env_settings of {name}", given, rule)  # type: ignore[misc]  # of the instance here

    def seed(self, seed: int) -> None:
        """Keep the seed for the first message of the episode."""
        self._seed = seed

    def reset(self, observation: Observation, info: Info) -> None:
        """Send the first observation."""
        self._space: gym.spaces.Box = info["action_space"]
        known: Fields = {
            key: value for key, value in info.items() if isinstance(value, str | int | float | bool)
        }
        cell = info.get("cell")
        known |= {"cell": cell.version} if isinstance(cell, Cell) else {}
        known["action_space"] = {"low": self._space.low, "high": self._space.high}
        self._left = []
        self._begin = {
            "reset": True,
            "seed": self._seed,
            "info": known,
            "prompt": "grasp the object on the table, lift it and hold it",
        }
        self._ask(observation)

    def act(self, observation: Observation) -> Single:
        """Return the next action of the last answer, or that of a new one."""
        if not self._left and not self.report.failure:
            self._ask(observation)
        if not self._left:  # the report says why
            return np.zeros(self._space.shape, self._space.dtype)
        return self._left.pop(0)

    def _ask(self, observation: Observation) -> None:
        """Send an observation; take actions and report from the answer."""
        try:
            answer = unpack(self._answer(pack({**observation, **self._begin})))
            self.report = read(Report, answer.get("report") or {}, "report", more=True)
            given_up = bool(self.report.failure) and not self.report.again
            self._left = list(_actions(answer, self._space, given_up))
        except InputError as error:
            self.close()
            reason = error.reason if isinstance(error, _Failed) else "bad_answer"
            self.report = Report(reason, details={"server": str(error)})
        self._begin = {}

    def _answer(self, message: bytes) -> bytes:
        from websockets.exceptions import WebSocketException
        from websockets.protocol import State

        if self._begin and self._socket is not None and self._socket.state is not State.OPEN:
            self.close()  # since the last episode
        if self._socket is None:
            if not self._begin:
                raise _Failed(SERVER_GONE, "the connection broke within the episode")
            self._connect()
        try:
            self._socket.send(message)
            answer: str | bytes = self._socket.recv(self._seconds)
        except TimeoutError:
            raise _Failed("server_slow", f"no answer within {self._seconds:g} s") from None
        except (WebSocketException, OSError) as error:
            raise _Failed(SERVER_GONE, f"the connection broke: {first_line(error)}") from None
        if isinstance(answer, str):
            raise _Failed("server_error", answer[:2000])
        return answer

    def _connect(self) -> None:
        """Connect, and read what the server says of itself; a server that starts is waited for."""
        from websockets.exceptions import InvalidStatus, WebSocketException
        from websockets.sync.client import connect

        token = os.environ.get("DEXGRASP_TOKEN")
        seconds = 5.0  # that a server which starts, or was there, may be away
        settings: Fields = {
            "compression": None, "max_size": 64_000_000, "open_timeout": seconds, "close_timeout": 1.0,
            "proxy": None, "additional_headers": {"Authorization": f"Api-Key {token}"} if token else None,
        }  # fmt: skip
        end = time.monotonic() + seconds
        while True:
            try:
                self._socket = connect(self._address, **settings)
                first = self._socket.recv(seconds)
                break
            except InvalidStatus as error:
                raise _Failed(SERVER_GONE, f"it answers with HTTP {error.response.status_code}") from None
            except (OSError, TimeoutError, WebSocketException) as error:
                self.close()
                if time.monotonic() > end:
                    raise _Failed(SERVER_GONE, first_line(error) or type(error).__name__) from None
                time.sleep(0.2)
        if isinstance(first, str):
            raise _Failed("server_error", first)
        self.metadata: Fields = unpack(first)

    def close(self) -> None:
        """Close the connection; the next episode opens another."""
        socket, self._socket = self._socket, None
        if socket is not None:
            with suppress(Exception):
                socket.close()


class _Failed(InputError):  # noqa: N818  (a trial's failure, not an error)
    """A failure of the server that has a reason of its own."""

    def __init__(self, reason: str, words: str) -> None:
        super().__init__(words)
        self.reason = reason


def _parsed(name: str) -> tuple[str, float]:
    """Return the address to connect to, and the seconds for an answer."""
    try:
        parts = urlsplit(name)
        asked = parse_qs(parts.query, strict_parsing=bool(parts.query))
        seconds = float(asked.pop("timeout", ["60"])[0])
        if not parts.hostname or asked or not 0 < seconds < float("inf") or parts.port == 0:
            raise ValueError
    except ValueError:
        raise InputError(
            f"agent {name!r}: valid is ws://HOST:PORT or ws://HOST:PORT?timeout=SECONDS"
        ) from None
    return parts._replace(query="").geturl(), seconds


def _actions(answer: Fields, space: gym.spaces.Box, given_up: bool) -> Array:
    """Return the actions (H, n) of an answer, none only from a policy that gives up.

    Raises:
        InputError: for anything else.
    """
    try:
        rows = np.asarray(answer["actions"], dtype=np.float64)
        rows = rows[None] if rows.ndim == 1 and rows.shape == space.shape else rows
    except KeyError:
        raise InputError(f"the answer has no actions, but {', '.join(map(str, answer))}") from None
    except (TypeError, ValueError) as error:
        raise InputError(f"actions are no numbers: {first_line(error)}") from None
    if rows.ndim != 2 or rows.shape[1:] != space.shape or not (len(rows) or given_up):
        raise InputError(f"actions have shape {rows.shape}: valid is (H, {space.shape[0]}), H from 1 on")
    if not np.isfinite(rows).all():
        raise InputError("actions are not finite")
    return rows
