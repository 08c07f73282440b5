"""Policies of another process as agents: what goes wrong with their server fails trials with a reason."""

import json
import subprocess
import threading
import time
import venv
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from processes import typed
from refusals import refused
from tables import table
from websockets.sync.server import serve

from dexgrasp.evaluation.evaluate import evaluate
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.runs.messages import pack, unpack

STATE = {"obs_mode": "state", "control_mode": "joint_delta"}


class PolicyServer:
    """A server whose policy is a function of the message and its number in the connection."""

    def __init__(self, policy, metadata=None, port=0):
        self.policy, self.metadata = policy, {"env_settings": STATE} if metadata is None else metadata
        self.server = serve(self._connection, "127.0.0.1", port, compression=None)
        self.port = self.server.socket.getsockname()[1]
        self.messages = []
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def _connection(self, socket):
        socket.send(pack(self.metadata))
        for number, message in enumerate(socket):
            self.messages.append(unpack(message))
            answer = self.policy(self.messages[-1], number)
            if answer is None:
                return
            socket.send(answer if isinstance(answer, str | bytes) else pack(answer))

    def __enter__(self):
        self.name = f"ws://127.0.0.1:{self.port}?timeout=1.5"
        return self

    def __exit__(self, *_):
        self.server.shutdown()


def still(_message, _number, rows=1):
    return {"actions": np.zeros((rows, 23))}


def outcomes(name, folder, trials=1, **more):
    settings = EvaluationSettings.of([name], ["sugar_box"], trials=trials, seed=1, **more)
    return evaluate(settings, folder, progress=False)["agents"][name], [
        json.loads(line) for line in (folder / "trials.jsonl").read_text().splitlines()
    ]


def slow(_message, _number):
    time.sleep(3.0)
    return {"actions": np.zeros((1, 23))}


def answer(name, shape, number, *_):
    return {name: np.full(shape, number)}


@pytest.mark.parametrize(
    ("policy", "reason", "words"),
    [
        (slow, "server_slow", "no answer within 1.5 s"),
        (lambda message, number: None if number == 2 else still(message, number), "server_gone", "broke"),
        (lambda *_: "out of memory\nof the accelerator", "server_error", "out of memory"),
        (lambda *_: b"\xc1", "bad_answer", "msgpack"),
        (lambda *_: {"actions": ["left"]}, "bad_answer", "no numbers"),
        *((partial(answer, *given), "bad_answer", words) for *given, words in table("bad_answers")),
    ],
)
def test_a_fault_of_the_server_is_a_failure_with_its_reason(policy, reason, words, tmp_path):
    with PolicyServer(policy) as server:
        summary, rows = outcomes(server.name, tmp_path, trials=2)
    assert summary["failures"] == {reason: 2}
    assert all(words in row["details"]["server"] for row in rows)


def test_chunks_are_carried_out_before_the_next_is_asked_for(tmp_path):
    with PolicyServer(lambda message, number: still(message, number, rows=100)) as server:
        _, (row,) = outcomes(server.name, tmp_path)
    assert row["steps"] == 300
    first, *later = server.messages
    assert len(later) == 2
    assert first["reset"]
    assert first["seed"] == row["agent_seed"]
    assert first["info"]["control_period"] == 0.05
    assert not [message for message in later if {"reset", "seed", "info"} & set(message)]
    assert first["joint_positions"].shape == (23,)


def test_what_a_server_says_of_itself_is_part_of_the_run(tmp_path):
    with PolicyServer(still, {"env_settings": STATE, "weights": "a"}) as server:
        outcomes(server.name, tmp_path)
        server.metadata = {"env_settings": STATE, "weights": "b"}
        with refused("weights: a there, b now"):
            outcomes(server.name, tmp_path)


def test_trials_that_met_no_server_are_made_again(tmp_path):
    calls = iter(range(10**6))

    def dies(message, number):
        return still(message, number, rows=100) if next(calls) < 4 else None

    with PolicyServer(dies) as server:
        summary, _ = outcomes(server.name, tmp_path / "run", trials=3)
        assert summary["failures"]["server_gone"] == 2
    with PolicyServer(lambda *given: still(*given, rows=100), port=server.port) as server:
        resumed, rows = outcomes(server.name, tmp_path / "run", trials=3)
        whole, _ = outcomes(server.name, tmp_path / "whole", trials=3)
    assert len(rows) == 5
    assert resumed["failures"] == whole["failures"]
    assert resumed["trials"] == 3
    with refused("no policy server"):
        outcomes(server.name, tmp_path / "run", trials=3)


def test_what_the_protocol_decides_is_no_wish_of_a_server(capsys):
    with PolicyServer(still, {"env_settings": {"friction": 3}}) as server:
        assert typed(f"evaluate --agents {server.name} --objects pear --trials 1") == 2
        assert "which the protocol decides" in capsys.readouterr().err


POLICY = """
import importlib.util, msgpack, numpy
from websockets.sync.server import serve

def act(socket):
    socket.send(msgpack.packb({"env_settings": {"obs_mode": "state", "control_mode": "joint_delta"}}))
    for message in socket:
        action = numpy.zeros((50, 23))
        array = {b"__ndarray__": True, b"data": action.tobytes(), b"dtype": "<f8", b"shape": action.shape}
        socket.send(msgpack.packb({"actions": array}))

with serve(act, "127.0.0.1", 0) as server:
    for name in ("dexgrasp", "dexgrasp_env", "gymnasium", "mujoco"):
        assert importlib.util.find_spec(name) is None
    print(server.socket.getsockname()[1], flush=True)
    server.serve_forever()
"""


def test_a_policy_needs_nothing_of_this_package(tmp_path):
    """It runs in a virtual environment that has numpy, msgpack and websockets alone."""
    venv.create(tmp_path / "venv", symlinks=True)
    packages = next((tmp_path / "venv").glob("lib/python*/site-packages"))
    for name in ("numpy", "numpy.libs", "msgpack", "websockets"):
        (packages / name).symlink_to(Path(np.__file__).parents[1] / name)
    command = [tmp_path / "venv/bin/python", "-I", "-c", POLICY]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=tmp_path)
    try:
        _, (row,) = outcomes(f"ws://127.0.0.1:{int(process.stdout.readline())}", tmp_path)
        assert row["steps"] == 300
    finally:
        process.kill()
        process.stdout.close()


def test_a_served_agent_acts_as_in_this_process(tmp_path):
    from dexgrasp.cli.serving.served_agents import ServedAgents

    episodes = ServedAgents("hardcoded", None)
    metadata = unpack(pack(episodes.metadata()))
    with PolicyServer(lambda message, _: episodes.answer(0, message), metadata) as server:
        _, remote = outcomes(server.name, tmp_path / "remote", trials=2)
    _, here = outcomes("hardcoded", tmp_path / "here", trials=2)
    changed = ("agent", "seconds", "planning_seconds")
    assert [{k: v for k, v in row.items() if k not in changed} for row in remote] == [
        {k: v for k, v in row.items() if k not in changed} for row in here
    ]
