"""A client of `dexgrasp serve` that needs websockets, msgpack and numpy, and nothing of dexgrasp.

    python examples/serve_client.py                        starts a server of its own
    python examples/serve_client.py ws://127.0.0.1:8000    asks one that runs
"""

import subprocess
import sys

import msgpack
import numpy as np
from websockets.sync.client import connect


def pack_array(value):
    if isinstance(value, np.ndarray):
        return {b"__ndarray__": True, b"data": value.tobytes(), b"dtype": value.dtype.str, b"shape": value.shape}
    raise TypeError(type(value).__name__)


def unpack_array(given):
    if b"__ndarray__" in given:
        return np.frombuffer(given[b"data"], given[b"dtype"].decode()).reshape(given[b"shape"])
    return given


def cloud(rng):
    """Return points (8000, 3) m of a box on a table, in the frame of the robot's base."""
    box = rng.uniform(size=(4000, 3))
    box[np.arange(4000), rng.integers(0, 3, 4000)] = rng.integers(0, 2, 4000)  # on one of its faces
    table = rng.uniform([0.3, -0.25, 0.0], [0.75, 0.25, 0.0], (4000, 3))
    return np.concatenate([[0.47, -0.04, 0.0] + box * [0.06, 0.08, 0.07], table]) + rng.normal(0.0, 0.001, (8000, 3))


def ask(socket, **request):
    socket.send(msgpack.packb(request, default=pack_array))
    answer = socket.recv()
    if isinstance(answer, str):  # the line of an error
        sys.exit(answer)
    return msgpack.unpackb(answer, object_hook=unpack_array)


server, address = None, sys.argv[-1]
if len(sys.argv) == 1:
    command = [sys.executable, "-m", "dexgrasp.cli.main", "serve", "--port", "0", "--workers", "1"]
    server = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    address = next(line.split()[1] for line in server.stderr if line.startswith("ready: "))
try:
    with connect(address, compression=None, max_size=None) as socket:
        print("serves", msgpack.unpackb(socket.recv(), object_hook=unpack_array)["requests"])
        points = cloud(np.random.default_rng(0))
        for one in ask(socket, request="objects", points=points)["objects"]:
            print("sees", one)
        plan = ask(socket, request="plan_cloud", points=points, seed=1, mass=0.2)
        print("grasp:", plan["success"], "load", plan["certificate"]["load"])
        print("holds:", ask(socket, request="verify", grasp=plan["grasp"])["holds"])
finally:
    if server is not None:
        server.terminate()
        server.wait()
