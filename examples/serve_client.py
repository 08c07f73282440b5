"""A client of `dexgrasp serve` that needs websockets, msgpack and numpy, and nothing of dexgrasp.

python examples/serve_client.py [ws://127.0.0.1:8000]    without an address a server is started
"""

import subprocess
import sys
import time
from typing import Any

import msgpack
import numpy as np
from websockets.sync.client import connect


def pack_array(value: Any) -> Any:
    return {b"__ndarray__": 1, b"data": value.tobytes(), b"dtype": value.dtype.str, b"shape": value.shape}


def unpack_array(given: dict[Any, Any]) -> Any:
    if b"__ndarray__" in given:
        return np.frombuffer(given[b"data"], given[b"dtype"]).reshape(given[b"shape"])
    return given


def ask(socket: Any, **request: Any) -> Any:
    socket.send(msgpack.packb(request, default=pack_array))
    answer = socket.recv()
    if isinstance(answer, str):
        sys.exit(answer)  # the line of an error
    return msgpack.unpackb(answer, object_hook=unpack_array)


rng = np.random.default_rng(0)
box = rng.uniform(size=(4000, 3))
box[np.arange(4000), rng.integers(0, 3, 4000)] = rng.integers(0, 2, 4000)  # on one of its faces
table = rng.uniform([0.3, -0.25, 0.0], [0.75, 0.25, 0.0], (4000, 3))
points = np.concatenate([[0.47, -0.04, 0.0] + box * [0.06, 0.08, 0.07], table])  # m, robot base frame
points += rng.normal(0.0, 0.001, points.shape)

server, address = None, sys.argv[-1]
if len(sys.argv) == 1:
    command = [sys.executable, "-m", "dexgrasp.cli.main", "serve", "--port", "0", "--workers", "1"]
    server = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    address = next(line.split()[1] for line in server.stderr or () if line.startswith("ready: "))
try:
    with connect(address, compression=None, max_size=None) as socket:
        print("serves", msgpack.unpackb(socket.recv(), object_hook=unpack_array)["requests"])
        print("sees", ask(socket, request="objects", points=points)["objects"])
        plan = ask(socket, request="plan_cloud", points=points, seed=1, mass=0.2)
        print("grasp:", plan["success"], "load", plan["certificate"]["load"])
        print("holds:", ask(socket, request="verify", grasp=plan["grasp"])["holds"])
        began = time.perf_counter()
        answers = [ask(socket, request="plan_cloud", points=points, seed=k) for k in range(20)]
        spent = 1e3 * (time.perf_counter() - began) - sum(one["timing_ms"]["perception"] for one in answers)
        print(f"planning and transport: {spent / 20:.0f} ms a request")
finally:
    if server is not None:
        server.terminate()
