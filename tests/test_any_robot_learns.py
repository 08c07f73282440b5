"""Demonstrations, training and evaluation of a gripper: nothing in them counts on 23 joints or three tips."""

import json

import pytest

pytest.importorskip("torch")

from processes import typed
from test_grippers import SLIDES, made

from dexgrasp.planning.decoder import read_decoder

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    folder = tmp_path_factory.mktemp("slides")
    made(folder, SLIDES)
    return str(folder / "mine.yaml")


def done(capsys, command):
    """Run a command, which has to succeed, and return what it prints as JSON."""
    assert typed(f"{command} --json") == 0
    return json.loads(capsys.readouterr().out)


def test_a_gripper_is_demonstrated_cloned_and_evaluated(robot, tmp_path, capsys):
    demos, bc, of = tmp_path / "demos", tmp_path / "bc", f"--objects pill_bottle --robot {robot}"
    about = done(capsys, f"demos generate --agent hardcoded {of} --episodes 2 --out {demos}")
    assert about["episodes"] >= 1
    done(capsys, f"train bc --data {demos} --out {bc} --epochs 1")
    found = done(capsys, f"evaluate --agents {bc} hardcoded {of} --trials 1 --out {tmp_path / 'run'}")
    assert all(of["trials"] == 1 for of in found["agents"].values())


def test_pairs_of_contacts_are_sampled_and_learned(robot, tmp_path, capsys):
    data, cvae = tmp_path / "data", tmp_path / "cvae"
    made_of = f"--objects pill_bottle --grasps-per-pose 30 --robot {robot}"
    done(capsys, f"dataset generate {made_of} --out {data}")
    done(capsys, f"train cvae --data {data} --out {cvae} --epochs 1")
    weight, _ = read_decoder(cvae / "cvae.safetensors").layers[-1]
    assert weight.shape[1] == 3 * 2 + 9
