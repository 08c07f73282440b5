"""A PyTorch policy in an environment of its own, without dexgrasp: it needs torch, numpy, msgpack and websockets.

python policy_server.py 8001    serves; without a port it serves on a free one, and `dexgrasp evaluate` asks it here
"""

import asyncio
import sys
from typing import Any

import msgpack
import numpy as np
import torch
from websockets.asyncio.server import ServerConnection, serve

SEES = ("joint_positions", "joint_velocities", "object_pose", "palm_pose")
SIZE, ACTIONS, CHUNK = 23 + 23 + 7 + 7, 23, 25  # of the default robot; actions of an answer
EVALUATE = ["-m", "dexgrasp.cli.main", "evaluate", "--objects", "sugar_box", "--trials", "1", "--agents"]
ABOUT = {"env_settings": {"obs_mode": "state", "control_mode": "joint_delta"}, "weights": "untrained-0"}


def pack_array(value: np.ndarray) -> dict[bytes, Any]:
    """Return what msgpack holds of an array, as `openpi-client` has it."""
    return {b"__ndarray__": True, b"data": value.tobytes(), b"dtype": value.dtype.str, b"shape": value.shape}


def unpack_array(given: dict[Any, Any]) -> Any:
    """Return the array that a mapping stands for, any other mapping as it is."""
    if b"__ndarray__" in given:
        return np.frombuffer(given[b"data"], given[b"dtype"]).reshape(given[b"shape"])
    return given


torch.manual_seed(0)
network = torch.nn.Sequential(  # yours: torch.load, torch.jit.load, or a function of JAX
    torch.nn.Linear(SIZE, 64), torch.nn.Tanh(), torch.nn.Linear(64, CHUNK * ACTIONS), torch.nn.Tanh()
)


async def answer(socket: ServerConnection) -> None:
    """Send what is served, then answer each observation with the next actions."""
    await socket.send(msgpack.packb(ABOUT))
    async for message in socket:
        observation = msgpack.unpackb(message, object_hook=unpack_array)
        state = np.concatenate([np.ravel(observation[name]) for name in SEES])
        rows = network(torch.from_numpy(state).float()).detach().reshape(CHUNK, ACTIONS).numpy()
        await socket.send(msgpack.packb({"actions": rows}, default=pack_array))


async def main(port: int) -> int:
    """Serve for ever, or, on a free port, until it has been evaluated; return the exit status."""
    async with serve(answer, "127.0.0.1", port, compression=None) as server:
        address = f"ws://127.0.0.1:{server.sockets[0].getsockname()[1]}"
        print("serves at", address, flush=True)
        if port:
            await server.serve_forever()
        return await (await asyncio.create_subprocess_exec(sys.executable, *EVALUATE, address)).wait()


sys.exit(asyncio.run(main(int(sys.argv[1]) if len(sys.argv) > 1 else 0)))
