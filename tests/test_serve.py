"""A server of grasps: it answers as the commands do, and whatever comes in, it goes on."""

import json
import os
import re
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import trimesh
from processes import typed
from refusals import refused
from robots import CELL
from tables import mistakes
from test_scene_cloud import scene_points
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from dexgrasp.runs.messages import pack, unpack

TOKEN = "a token"
SERVE = "-m dexgrasp.cli.main serve --port 0 --workers 1"


class Served:
    """A server process, and connections to it."""

    def __init__(self, *options):
        command = [sys.executable, *SERVE.split(), *options]
        environment = {**os.environ, "DEXGRASP_TOKEN": TOKEN}
        self.process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
        self.lines = []
        for line in self.process.stderr:
            self.lines.append(line)
            if line.startswith("ready: "):
                break
        self.address = re.search(r"ws://\S+", self.lines[-1])[0]

    def connect(self, token=TOKEN, **more):
        headers = {"Authorization": f"Api-Key {token}"} | more
        socket = connect(self.address, compression=None, max_size=None, additional_headers=headers)
        self.metadata = unpack(socket.recv())
        return socket

    def get(self, path, token=TOKEN):
        asked = urllib.request.Request(
            self.address.replace("ws", "http", 1) + path, headers={"Authorization": f"Api-Key {token}"}
        )
        return urllib.request.urlopen(asked).read().decode()

    def worker(self):
        """Return the number of the worker process."""
        own = self.process.pid
        return int(Path(f"/proc/{own}/task/{own}/children").read_text().split()[0])


@pytest.fixture(scope="module")
def served():
    server = Served("--seconds", "20", "--megabytes", "2", "--connections", "3")
    yield server
    server.process.kill()
    server.process.stderr.close()


@pytest.fixture(scope="module")
def points():
    return scene_points(np.random.default_rng(4), (0.505, -0.005))


def ask(socket, **request):
    socket.send(pack(request))
    answer = socket.recv(60)
    return answer if isinstance(answer, str) else unpack(answer)


def timeless(content):
    """Return an answer without the times that it took."""
    if isinstance(content, dict):
        drop = ("stages", "planning_seconds", "created", "timing_ms")
        return {key: timeless(value) for key, value in content.items() if key not in drop}
    return [timeless(value) for value in content] if isinstance(content, list) else content


def test_an_answer_is_the_commands(served, points, tmp_path, printed):
    np.save(tmp_path / "scene.npy", points)
    cloud = f"--cloud {tmp_path / 'scene.npy'} --json"
    assert typed(f"plan {cloud} --seed 7 --mass 0.2") == 0
    told = printed()
    with served.connect() as socket:
        assert served.metadata["requests"] == ["plan", "plan_cloud", "objects", "verify"]
        plan = ask(socket, request="plan_cloud", points=points, seed=7, mass=0.2, name="scene")
        assert timeless(plan) == timeless(told)
        assert ask(socket, request="verify", grasp=plan["grasp"])["holds"]
        assert typed(f"plan {cloud} --objects") == 0
        objects = ask(socket, request="objects", points=points)
        assert timeless(objects) == printed()
        spent = plan["timing_ms"]
        assert list(spent) == ["queue", "perception", "planning", "encoding"]
        assert min(spent.values()) >= 0.0 < spent["perception"] < spent["planning"] + 60_000.0


def test_a_target_a_mesh_and_a_depth_image_are_planned_for(served, points):
    with served.connect() as socket:
        assert ask(socket, request="plan", target="pear", seed=3)["success"]
        block = trimesh.creation.box((40, 60, 50))
        mesh = {"vertices": np.array(block.vertices), "faces": np.array(block.faces), "mesh_scale": 0.001}
        upper = block.triangles_center[:, 2] > -24.0
        found = ask(socket, request="plan", name="block", seed=1, hold=[upper], **mesh)
        assert (found["success"], found["object"]) == (True, "block")
        assert found["grasp"]["request"]["hold"][0]["radius"] > 0.0
        wrong = ask(socket, request="plan", name="block", hold=[upper[:3]], **mesh)
        assert f"valid is one for each of {len(block.faces)} faces" in wrong
        beside = points[:, 1] > -0.02
        held = ask(socket, request="plan_cloud", points=points, seed=1, hold=[beside], max_force=9.0)
        assert all(contact["point"][1] > -0.03 for contact in held["grasp"]["contacts"])
        env = gym.make("DexGrasp/Lift-v2", objects="sugar_box", obs_mode="depth", observe="reset")
        depth, camera = env.reset(seed=0)[0]["depth"][0], CELL.make_cameras()[0]
        lens, place = camera.intrinsics, env.unwrapped.data.body("object").xpos
        K = [[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]]
        seen = ask(socket, request="objects", depth=depth, K=K, T_base_camera=camera.T_world_camera)
        assert np.allclose(seen["objects"][0]["place"], place, atol=0.03)


def test_a_mistake_is_a_line(served, points):
    with served.connect() as socket:
        for request, words in mistakes("requests"):
            shown = {"points": points} if request.get("points") == "POINTS" else {}
            answer = ask(socket, **request | shown)
            assert isinstance(answer, str), request
            assert words in answer, (answer, words)
            assert len(answer.splitlines()) == 1


def damaged(rng, good):
    """Return bytes that are no message, of many kinds."""
    lying = {b"__ndarray__": True, b"data": b"12345678", b"dtype": "|O", b"shape": [1]}
    large = {b"__ndarray__": True, b"data": b"", b"dtype": "<f8", b"shape": [2**40, -3]}
    place = rng.integers(1, 80)
    kinds = [
        rng.bytes(rng.integers(1, 200)),
        good[: rng.integers(1, len(good))],
        good[:place] + rng.bytes(3) + good[place + 3 :],
        pack({"request": [1, {"a": None}], "points": "x" * 50}),
        *(pack({"request": "plan_cloud", "points": array}) for array in (lying, large)),
        b"\x91" * 5000 + b"\x01",
    ]
    return kinds[rng.integers(len(kinds))]


def test_damaged_messages_are_errors_and_the_server_goes_on(served, points):
    rng = np.random.default_rng(0)
    good = pack({"request": "objects", "points": points[:300].astype(np.float32)})
    with served.connect() as socket:
        pid = served.worker()
        for _ in range(300):
            socket.send(damaged(rng, good))
            assert socket.recv(30) is not None  # an error, or the answer where the damage was in a number
        socket.send("text")
        assert "send msgpack" in socket.recv(30)
        assert ask(socket, request="plan_cloud", points=points)["success"]
        assert served.worker() == pid
    with served.connect() as socket:
        socket.send(b"\x00" * 2_500_000)
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(30)
        assert closed.value.rcvd.code == 1009


def test_who_has_no_token_or_comes_from_a_page_is_refused(served):
    for given, status in (({"token": "another"}, 401), ({"Origin": "http://elsewhere"}, 403)):
        with pytest.raises(InvalidStatus) as refused:
            served.connect(**given)
        assert refused.value.response.status_code == status
    assert served.get("/healthz", "none") == "ok\n"
    assert "requests" in json.loads(served.get("/metrics"))
    with pytest.raises(urllib.error.HTTPError):
        served.get("/metrics", "none")
    sockets = [served.connect() for _ in range(3)]
    with pytest.raises(InvalidStatus) as refused:
        served.connect()
    assert refused.value.response.status_code == 503
    for socket in sockets:
        socket.close()


def test_a_worker_that_is_killed_is_replaced(served, points):
    with served.connect() as socket:
        os.kill(served.worker(), signal.SIGKILL)
        assert "another one is started" in ask(socket, request="plan_cloud", points=points)
        assert ask(socket, request="plan_cloud", points=points)["success"]


def test_a_signal_ends_it_when_what_is_in_hand_is_answered(points):
    server = Served()
    with server.connect() as socket:
        assert ask(socket, request="plan_cloud", points=points)["success"]
        socket.send(pack({"request": "plan", "target": "pear", "seed": 0}))
        time.sleep(0.3)
        server.process.send_signal(signal.SIGTERM)
        assert unpack(socket.recv(60))["success"]
    assert server.process.wait(20) == 0
    assert not server.process.stderr.read()  # a line each would fill a pipe in the end
    server.process.stderr.close()


def test_arrays_arrive_as_they_were_and_nothing_else_is_made():
    for array in (np.arange(6.0).reshape(2, 3), np.zeros((0, 3), np.float32), np.array(True), np.int16(3)):
        (found,) = unpack(pack({"a": array})).values()
        assert np.array_equal(found, array)
        assert found.dtype == array.dtype
    with pytest.raises(TypeError):
        pack({"a": np.array([object()])})
    with refused():
        unpack(pack({"a": {b"__npgeneric__": True, b"data": "x", b"dtype": "<M8[s]"}}))
