"""Replay in Bullet: bodies where MuJoCo has them, statics on the table, and one line where PyBullet is missing."""

import contextlib
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from robots import CELL, HOME

from dexgrasp.cli.commands import run_script
from dexgrasp.export.read import Recording, Rows
from dexgrasp.export.scene_folder import write_scene
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.load import load_object
from dexgrasp_env.scene.build import build_scene

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))
from replay_bullet import STEP, Bullet, World, replay_in_bullet

REST = [0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]


def world_of(name, lift=0.0):
    """A Bullet world with an object upright on the table, or above it."""
    shape = load_object(name)
    model, pose = build_scene(shape, CELL, friction=0.7), np.array(REST)
    pose[2] = lift - shape.solid.vertices[:, 2].min()
    return model, World(model, HOME, pose), pose


def test_a_missing_pybullet_is_named_in_one_line(monkeypatch, tmp_path):
    import importlib.util

    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *a: None if name == "pybullet" else found(name, *a)
    )
    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(
        InputError, match=r"^replay in Bullet needs pybullet: pip install -c constraints.txt pybullet$"
    ):
        replay_in_bullet(still(), tmp_path / "scene.xml")
    assert run_script(Bullet, [str(tmp_path)]) == 2


def still(seconds=0.1):
    times = np.array([0.0, seconds])
    rows = [Rows(times, np.tile(part, (2, 1))) for part in (HOME[:7], HOME[7:])]
    return Recording(*rows, {})


def test_links_and_weights_are_mujocos():
    pytest.importorskip("pybullet")
    model, world, _ = world_of("sugar_box")
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    with contextlib.closing(world):
        for _ in range(3):
            data.qpos[:23] = rng.uniform(*model.jnt_range[:23].T)
            mujoco.mj_forward(model, data)
            world.place(data.qpos[:23])
            for body in range(2, model.body("table").id):
                state = world.client.getLinkState(world.robot, body - 2, computeForwardKinematics=1)
                position, (x, y, z, w) = state[4:6]
                np.testing.assert_allclose(position, data.xpos[body], atol=1e-6)
                assert abs(np.dot([w, x, y, z], data.xquat[body])) == pytest.approx(1.0, abs=1e-6)
            np.testing.assert_allclose(world.weight(data.qpos[:23]), data.qfrc_gravcomp[:23], atol=1e-9)


@pytest.mark.parametrize("name", ["sugar_box", "webcam"])
def test_objects_touch_the_table_where_their_surface_is(name):
    """No margin is left around hulls: dropped from half a millimetre, it comes to rest that much lower."""
    pytest.importorskip("pybullet")
    _, world, pose = world_of(name, lift=0.0005)
    with contextlib.closing(world):
        for _ in range(round(0.2 / STEP)):
            world.step(HOME)
        assert world.height() == pytest.approx(pose[2] - 0.0005, abs=1e-4)


@pytest.mark.parametrize("slope", [0.65, 0.75])
def test_friction_is_the_scenes(slope):
    """Gravity is tilted: within 0.3 s a flat box slides as far as Coulomb's law says, here with 0.7."""
    pytest.importorskip("pybullet")
    _, world, pose = world_of("sandwich_side")
    across, down = 9.81 * np.array([slope, 1.0]) / np.hypot(1.0, slope)
    with contextlib.closing(world):
        world.client.setGravity(0.0, across, -down)
        for _ in range(round(0.3 / STEP)):
            world.client.stepSimulation()
        position, _ = world.client.getBasePositionAndOrientation(world.object)
    assert position[1] - pose[1] == pytest.approx(0.5 * max(0.0, across - 0.7 * down) * 0.3**2, abs=5e-4)


def test_what_is_not_grasped_stays_on_the_table(tmp_path):
    pytest.importorskip("pybullet")
    T = np.eye(4)
    T[:3, 3] = 0.5, 0.0, 0.0225
    write_scene(tmp_path, load_object("sugar_box"), T, CELL)
    outcome = replay_in_bullet(still(), tmp_path / "scene.xml", np.random.default_rng(0))
    assert not outcome.success
