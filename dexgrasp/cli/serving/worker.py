"""Worker process of the server: reads frames from standard input, writes answers to what was standard output.

A frame is its length (4 bytes), a kind (1), the number of a connection (8), the seconds that it waited (8), and a
message; an answer is its length, a kind, and a message or the text of an error. Only the server starts
`python -m dexgrasp.cli.serving.worker`.
"""

import os
import struct
import sys
import traceback
from typing import Any, BinaryIO

from dexgrasp.runs.messages import pack, unpack
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError

HEAD = struct.Struct("<IBQd")
SIZE = struct.Struct("<IB")
MESSAGE, CLOSED = 0, 1
"""Kinds of frames."""
ANSWER, REFUSED, FAULT = 0, 1, 2
"""Kinds of answers: a mapping; the line of a client's mistake; the line of an internal fault."""


class _Service:
    """Handler of the messages of all connections of a worker."""

    def __init__(self, settings: Fields) -> None:
        from dexgrasp import __name__ as package
        from dexgrasp.cli.serving.requests import REQUESTS, answer
        from dexgrasp.evaluation.settings import code_hash
        from dexgrasp_env import __version__

        robot, agent = settings["robot"], settings["agent"]
        self._robot, self._agents = robot, None
        answer(
            {"request": "plan_cloud", "points": _box(robot)}, robot
        )  # compiled code and weights are loaded
        self.metadata: Fields = {
            "server": package,
            "version": __version__,
            "requests": list(REQUESTS),
            "code": code_hash([agent] if agent else []),
        }
        if agent:
            from dexgrasp.cli.serving.served_agents import ServedAgents

            self._agents = ServedAgents(agent, robot)
            self.metadata |= self._agents.metadata()

    def reply(self, connection: int, waited: float, data: bytes) -> Fields:
        """Return the answer to a packed message that waited for so many seconds."""
        from dexgrasp.cli.serving.requests import answer

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
    import numpy as np

    from dexgrasp_env.robot.cell import make_cell

    grid = np.linspace(0.0, 1.0, 12)
    cube = np.stack(np.meshgrid(grid, grid, grid), axis=-1).reshape(-1, 3)
    box = cube[((cube == 0) | (cube == 1)).any(1)] * [0.05, 0.07, 0.06] + [0.475, -0.035, 0.0]
    table = np.stack(np.meshgrid(np.linspace(0.3, 0.7, 40), np.linspace(-0.2, 0.2, 40), [0.0]), axis=-1)
    return np.concatenate([box, table.reshape(-1, 3)]) - make_cell(robot).base


def main() -> int:
    """Answer frames until there are no more."""
    source, target = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is not an answer
    try:
        service = _Service(unpack(_frame(source)[3]))
    except InputError as error:
        _write(target, REFUSED, str(error).encode())
        return 2
    _write(target, ANSWER, pack(service.metadata))
    while (frame := _frame(source))[0] is not None:
        kind, connection, waited, data = frame
        if kind == CLOSED:
            service.end(connection)
            continue
        try:
            _write(target, ANSWER, pack(service.reply(connection, waited, data)))
        except InputError as error:
            _write(target, REFUSED, str(error).encode())
        except Exception as error:
            traceback.print_exc()
            _write(target, FAULT, f"a fault of the server: {type(error).__name__}: {error}".encode())
    return 0


def _frame(source: BinaryIO) -> tuple[int | None, int, float, bytes]:
    head = source.read(HEAD.size)
    if len(head) < HEAD.size:
        return None, 0, 0.0, b""
    size, kind, connection, waited = HEAD.unpack(head)
    return kind, connection, waited, source.read(size)


def _write(target: BinaryIO, kind: int, data: bytes) -> None:
    target.write(SIZE.pack(len(data), kind) + data)
    target.flush()


if __name__ == "__main__":
    sys.exit(main())
