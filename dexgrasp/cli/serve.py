"""`dexgrasp serve`: planner and agents over WebSocket, with code and weights loaded."""

import asyncio
import os
from typing import Annotated

from dexgrasp.cli.command import Answer, CellOptions, Command
from dexgrasp.cli.output import note
from dexgrasp.cli.serving.server import Server, ServerSettings
from dexgrasp.registry import check_name
from dexgrasp_env.arrays import Fields
from dexgrasp_env.cores import usable_cores
from dexgrasp_env.extras import require_extra


class Serve(Command, CellOptions):
    """Answer requests for grasps, and act as a policy, until a signal ends it.

    examples:
      dexgrasp serve                                     plan, plan_cloud, objects and verify at ws://127.0.0.1:8000
      dexgrasp serve --agent bilevel --port 8001         and an agent: observation in, actions out
      dexgrasp evaluate --agents ws://127.0.0.1:8001 --objects ycb6
      python examples/serve_client.py ws://127.0.0.1:8000    a client that has none of this installed

    Messages are msgpack as the package `openpi-client` writes it: docs/serve.md. "ready" on standard error says that
    compiled code and weights are loaded. Where $DEXGRASP_TOKEN is set, clients must send it. /healthz and /metrics are
    answered by HTTP. SIGTERM ends it when what is in hand is answered.

    Attributes:
        agent: that is served, see dexgrasp list agents (default: none, requests alone).
        server: where and how much.
    """

    agent: Annotated[str | None, "AGENT"] = None
    server: ServerSettings = ServerSettings()

    def run(self) -> Answer | int:
        """Serve until a signal; return the counters."""
        require_extra("serve", "dexgrasp serve")
        if self.agent is not None:
            check_name(self.agent)
        _ = self.cell  # a file that is none is refused before processes are started
        served = {"agent": self.agent, "robot": self.robot}
        workers = self.server.workers or usable_cores()
        server = Server(self.server, workers, served, os.environ.get("DEXGRASP_TOKEN") or None)

        def ready(port: int, metadata: Fields) -> None:
            """Print the address and the requests that are served."""
            what = ", ".join([*metadata["requests"], *([f"agent {self.agent}"] if self.agent else [])])
            note(f"ready: ws://{self.server.host}:{port} ({what}; {workers} workers)")

        asyncio.run(server.run(ready))
        counted = dict(server.counters)
        return Answer({"counters": counted}, f"served {counted.get('requests', 0)} requests")
