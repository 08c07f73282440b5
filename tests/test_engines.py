"""Other engines: bodies, contacts and servos as MuJoCo has them, and one line where an engine is missing."""

import contextlib
import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from refusals import refused
from robots import CELL, HOME

from dexgrasp.cli.commands import run_script
from dexgrasp.export.formats import write_scene
from dexgrasp.export.read import Recording, Rows
from dexgrasp_env.objects.load import load_object
from dexgrasp_env.poses import rigid
from dexgrasp_env.scene.build import build_scene

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))
from compare_engines import CompareEngines, ReplayTrajectory, rank_violation, replay
from engines.scene import PACKAGES, make_world

REST = [0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
ENGINES = [
    pytest.param(name, marks=pytest.mark.skipif(importlib.util.find_spec(module) is None, reason=module))
    for name, module in PACKAGES.items()
]


def world_of(engine, name, lift=0.0, gravity=None):
    """A world with an object upright on the table, or above it."""
    shape, pose = load_object(name), np.array(REST)
    model = build_scene(shape, CELL, friction=0.7)
    if gravity is not None:
        model.opt.gravity[:] = gravity
    pose[2] = lift - shape.solid.vertices[:, 2].min()
    return make_world(engine, model, HOME, pose), pose


def still(seconds=0.1):
    times = np.array([0.0, seconds])
    rows = [Rows(times, np.tile(part, (2, 1))) for part in (HOME[:7], HOME[7:])]
    return Recording(*rows, {})


def test_a_missing_engine_is_named_in_one_line(monkeypatch, tmp_path):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name != "pybullet" or None)
    write_scene(tmp_path, load_object("sugar_box"), rigid(np.eye(3), [0.5, 0.0, 0.0225]), CELL)
    with refused("^bullet is not installed: pip install -c constraints.txt pybullet$"):
        replay(still(), tmp_path / "scene.xml", "bullet")
    assert run_script(ReplayTrajectory, [str(tmp_path / "none")]) == 2


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", ["sugar_box", "webcam"])
def test_objects_touch_the_table_where_their_surface_is(engine, name):
    """No margin is left around hulls: dropped from half a millimetre, it comes to rest that much lower."""
    world, pose = world_of(engine, name, lift=0.0005)
    with contextlib.closing(world):
        for _ in range(round(0.2 / world.step_seconds)):
            world.step(HOME)
        assert world.position()[2] == pytest.approx(pose[2] - 0.0005, abs=2e-4)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("slope", [0.65, 0.9])
def test_friction_is_the_scenes(engine, slope):
    """Gravity is tilted: under the friction angle, here of 0.7, a flat box stays; over it, it slides."""
    across, down = 9.81 * np.array([slope, 1.0]) / np.hypot(1.0, slope)
    world, pose = world_of(engine, "sandwich_side", gravity=[0.0, across, -down])
    with contextlib.closing(world):
        for _ in range(round(0.3 / world.step_seconds)):
            world.step(HOME)
        slid = world.position()[1] - pose[1]
    free = 0.5 * (across - 0.7 * down) * 0.3**2
    assert abs(slid) < 1e-3 if slope < 0.7 else 0.5 * free < slid < 1.5 * free


@pytest.mark.parametrize("engine", ENGINES)
def test_servos_and_links_are_the_scenes(engine):
    """After a step of its set-points of 0.1 rad the arm is where MuJoCo's is at the same time."""
    ends, target = [], HOME + np.r_[np.full(7, 0.1), np.zeros(16)]
    for name in ("mujoco", engine):
        world, _ = world_of(name, "sugar_box")
        with contextlib.closing(world):
            for _ in range(round(0.5 / world.step_seconds)):
                world.step(target)
            ends.append(world.joints())
    np.testing.assert_allclose(ends[1], ends[0], atol=4e-3)
    assert np.abs(ends[0] - HOME).max() > 0.05


def test_what_is_not_grasped_stays_on_the_table(tmp_path):
    _, pose = world_of("mujoco", "sugar_box")
    write_scene(tmp_path, load_object("sugar_box"), rigid(np.eye(3), pose[:3]), CELL)
    assert abs(replay(still(), tmp_path / "scene.xml", "mujoco", np.random.default_rng(0))) < 0.01


def test_rank_violation_counts_the_largest_gap_that_is_turned_about():
    assert rank_violation(np.array([0.9, 0.5, 0.1]), np.array([0.8, 0.6, 0.2])) == 0.0
    assert rank_violation(np.array([0.9, 0.5, 0.1]), np.array([0.6, 0.8, 0.2])) == pytest.approx(0.8 / 3)


def test_trials_are_compared_and_what_pushes_is_refused(tmp_path, capsys):
    arguments = [str(tmp_path), "--agents=random", "--objects=pear", "--engines=mujoco"]
    for _ in range(2):  # what is there is not run again
        assert run_script(CompareEngines, arguments) == 0
        assert "| mujoco | 1 of 1 " in capsys.readouterr().out
    assert run_script(CompareEngines, [*arguments, "--seed=1"]) == 2  # trials of another seed
    assert run_script(CompareEngines, [*arguments, "--protocol=pushed@1"]) == 2
