"""The scene: friction as Coulomb says, nothing that sticks, limits that hold."""

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose
from robots import CELL, HOME, JOINTS, TIPS

from dexgrasp_env.objects.load import load_object
from dexgrasp_env.scene.arena import read_arena
from dexgrasp_env.scene.build import build_scene

GRAVITY = 9.81


@pytest.fixture(scope="module")
def scene():
    return build_scene(load_object("sugar_box"), CELL)


def tip_pair(scene):
    """The first pair of a fingertip and the object."""
    tips = {scene.geom(name).id for name in TIPS}
    return next(i for i in range(scene.npair) if scene.pair_geom1[i] in tips or scene.pair_geom2[i] in tips)


def plate_on_tips(scene, friction):
    """A plate on three fixed spheres of a fingertip's size, with the physics and the pair settings of the scene."""
    pair = tip_pair(scene)
    spec = mujoco.MjSpec()
    spec.option = read_arena().option
    plate = spec.worldbody.add_body(name="plate", pos=[0, 0, 0.014 + 0.01])
    plate.add_freejoint()
    plate.add_geom(name="plate", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.2, 0.2, 0.01], mass=0.5)
    for i, angle in enumerate(np.deg2rad([0, 120, 240])):
        tip = f"tip{i}"
        place = [0.1 * np.cos(angle), 0.1 * np.sin(angle), 0]
        spec.worldbody.add_geom(name=tip, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.014, 0, 0], pos=place)
        spec.add_pair(
            name=tip, geomname1=tip, geomname2="plate", condim=int(scene.pair_dim[pair]),
            friction=[friction, friction, *scene.pair_friction[pair][2:]], solref=scene.pair_solref[pair],
            solimp=scene.pair_solimp[pair], solreffriction=scene.pair_solreffriction[pair],
        )  # fmt: skip
    return spec.compile()


def slides(model, slope, direction):
    """Metres the plate moves in half a second when gravity pulls along `direction` with tan(angle) = slope."""
    angle = np.arctan(slope)
    data = mujoco.MjData(model)
    for _ in range(200):
        mujoco.mj_step(model, data)
    start = data.qpos[:2].copy()
    down = [np.sin(angle) * np.cos(direction), np.sin(angle) * np.sin(direction), -np.cos(angle)]
    model.opt.gravity[:] = GRAVITY * np.array(down)
    for _ in range(250):
        mujoco.mj_step(model, data)
    model.opt.gravity[:] = [0, 0, -GRAVITY]
    return np.linalg.norm(data.qpos[:2] - start)


@pytest.mark.parametrize("friction", [0.4, 0.7, 1.0])
@pytest.mark.parametrize("degrees", [0.0, 22.0, 45.0, 80.0])
def test_slip_begins_at_mu_times_the_normal_force(scene, friction, degrees):
    model = plate_on_tips(scene, friction)
    direction = np.deg2rad(degrees)
    assert slides(model, 0.95 * friction, direction) < 0.001
    assert slides(model, 1.05 * friction, direction) > 0.010


def test_nothing_sticks(scene):
    assert scene.neq == 0
    assert scene.ntendon == 0
    assert not np.any(scene.pair_margin)
    assert not np.any(scene.geom_margin)
    # adhesion would be an actuator on a body
    assert np.all(scene.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT)
    assert [scene.actuator(i).name for i in range(scene.nu)] == list(JOINTS)


def test_gravity_acts_on_the_object_alone_as_it_should(scene):
    assert_allclose(scene.opt.gravity, [0, 0, -GRAVITY])
    assert scene.body_gravcomp[scene.body("object").id] == 0
    data = mujoco.MjData(scene)
    data.qpos[:23] = data.ctrl[:] = HOME
    data.qpos[23:30] = [0.5, 0.3, 1.0, 1, 0, 0, 0]
    for _ in range(100):
        mujoco.mj_step(scene, data)
    assert data.qpos[25] == pytest.approx(1.0 - 0.5 * GRAVITY * 0.2**2, abs=0.003)
