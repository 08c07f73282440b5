"""Worker process of the server, which alone starts `python -m dexgrasp.cli.serving.worker FD`, FD being its pipe.

Frames and answers are msgpack. The first frame are the settings; then each has the number of a connection, the seconds
that a message waited, and that message, None where the connection is closed. An answer is "" and a message, or a
counter and a line.
"""

import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from dexgrasp.cli.serving.requests import REQUESTS, answer
from dexgrasp.cli.serving.served_agents import ServedAgents
from dexgrasp.evaluation.settings import code_hash
from dexgrasp.registry import agent_files
from dexgrasp.runs.messages import pack, unpack
from dexgrasp_env import __version__
from dexgrasp_env.arrays import Fields, grid
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.cell import make_cell


class _Service:
    """Handler of the messages of all connections of a worker."""

    _robot: str | None = None
    _agents: ServedAgents | None = None

    def begin(self, agent: str | None, robot: str | None) -> Fields:
        """Load code and weights; return the first message of a connection."""
        self._robot = robot
        answer({"request": "plan_cloud", "points": _box(robot)}, robot)
        if agent:
            self._agents = ServedAgents(agent, robot)
        return {
            "server": "dexgrasp", "version": __version__, "requests": list(REQUESTS),
            "code": code_hash(agent_files(agent) if agent else ()),
            **(self._agents.metadata() if self._agents else {}),
        }  # fmt: skip

    def reply(self, connection: int, waited: float, data: bytes) -> Fields:
        """Return the answer to a packed message that waited for so many seconds."""
        message = unpack(data)
        if "request" in message:
            return answer(message, self._robot, waited)
        if self._agents is None:
            raise InputError(
                "a message has a request: plan, plan_cloud, objects or verify (no agent is served)"
            )
        return self._agents.answer(connection, message)

    def end(self, connection: int) -> None:
        """End the episode of a closed connection."""
        if self._agents is not None:
            self._agents.end(connection)


def _box(robot: str | None) -> Any:
    """Return a cloud (N, 3) m of a box on the table, in the frame of the robot's base."""
    cube = grid(*[np.linspace(0.0, 1.0, 12)] * 3)
    box = cube[((cube == 0) | (cube == 1)).any(1)] * [0.05, 0.07, 0.06] + [0.475, -0.035, 0.0]
    table = grid(np.linspace(0.3, 0.7, 40), np.linspace(-0.2, 0.2, 40), [0.0])
    return np.concatenate([box, table]) - make_cell(robot).base


def main() -> None:
    """Answer frames until the server closes the pipe."""
    pipe, service = Connection(int(sys.argv[1])), _Service()
    with suppress(EOFError):
        pipe.send_bytes(_answered(partial(service.begin, **unpack(pipe.recv_bytes()))))
        while True:
            frame = unpack(pipe.recv_bytes())
            if frame["data"] is None:
                service.end(frame["connection"])
            else:
                pipe.send_bytes(_answered(partial(service.reply, **frame)))


def _answered(reply: Callable[[], Fields]) -> bytes:
    answer: str | bytes
    try:
        counter, answer = "", pack(reply())
    except InputError as error:
        counter, answer = "refused", str(error)
    except Exception as error:
        traceback.print_exc()
        counter, answer = "faults", f"a fault of the server: {type(error).__name__}: {error}"
    return pack({"counter": counter, "answer": answer})


if __name__ == "__main__":
    main()
