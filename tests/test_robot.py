"""The robot against its figures: kinematics, masses, limits, contacts, servos."""

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose
from robots import (
    BODIES,
    CELL,
    FINGERS,
    HOME,
    JOINTS,
    LOWER,
    MOUNTS,
    ROBOT,
    TIPS,
    TORQUE,
    UPPER,
)

from dexgrasp_env.assets import asset_path
from dexgrasp_env.robot.model import robot_spec

DH_A = (0.0, 0.0, 0.0, 0.0825, -0.0825, 0.0, 0.088)
DH_D = (0.333, 0.0, 0.316, 0.0, 0.384, 0.0, 0.0)
DH_ALPHA = np.deg2rad((0, -90, 90, 90, -90, 90, 90))
HAND_ZERO = np.array([0.0] * 12 + [0.263, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def model():
    return robot_spec(CELL).compile()


@pytest.fixture(scope="module")
def hand():
    return mujoco.MjModel.from_xml_path(str(asset_path("robot", "allegro.xml")))


def dh_frames(q):
    """Frames of links 1..7 by the modified Denavit-Hartenberg rule, independently of the model."""
    T, frames = np.eye(4), []
    for a, d, alpha, angle in zip(DH_A, DH_D, DH_ALPHA, q, strict=True):
        ca, sa, c, s = np.cos(alpha), np.sin(alpha), np.cos(angle), np.sin(angle)
        rows = [[c, -s, 0, a], [s * ca, c * ca, -sa, -d * sa], [s * sa, c * sa, ca, d * ca], [0, 0, 0, 1]]
        T = T @ np.array(rows)
        frames.append(T)
    return frames


def placed(model, q):
    data = mujoco.MjData(model)
    data.qpos[:] = data.ctrl[:] = q
    mujoco.mj_forward(model, data)
    return data


def pairs_at(model, data, q):
    """Unordered pairs of bodies in contact."""
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    return {tuple(sorted(model.body(model.geom_bodyid[g]).name for g in c.geom)) for c in data.contact}


@pytest.mark.parametrize("mount", MOUNTS)
def test_names_and_orders(mount):
    model = robot_spec(CELL.mounted(mount)).compile()
    assert [model.joint(i).name for i in range(model.njnt)] == list(JOINTS)
    assert [model.actuator(i).name for i in range(model.nu)] == list(JOINTS)
    assert [model.body(i).name for i in range(1, model.nbody)] == list(BODIES)
    assert (model.actuator_trnid[:, 0] == np.arange(23)).all()
    for site in ("flange", ROBOT.hand.palm, *TIPS):
        model.site(site)
    for geom in TIPS:
        assert model.geom(geom).size[0] == 0.014


def test_arm_kinematics_follow_the_dh_table(model):
    rng = np.random.default_rng(0)
    for _ in range(20):
        q = rng.uniform(LOWER, UPPER)
        data = placed(model, q)
        frames = dh_frames(q[:7])
        for i, T in enumerate(frames, start=1):
            body = data.body(f"panda_link{i}")
            assert_allclose(body.xpos, T[:3, 3], atol=1e-9)
            assert_allclose(body.xmat.reshape(3, 3), T[:3, :3], atol=1e-9)
        flange = frames[-1] @ (0, 0, 0.107, 1)
        assert_allclose(data.site("flange").xpos, flange[:3], atol=1e-9)


def test_tips_lie_where_the_figures_say(hand):
    data = placed(hand, HAND_ZERO)
    mm = {finger: 1e3 * data.site(f"{finger}_tip").xpos for finger in FINGERS}
    assert_allclose(mm["index"], (0, 55.3, 133.4), atol=0.1)
    assert_allclose(mm["middle"], (0, 0, 136.2), atol=0.1)
    assert_allclose(mm["ring"], (0, -55.3, 133.4), atol=0.1)
    assert_allclose(mm["thumb"], (26, 161, -86), atol=1.0)
    data = placed(hand, np.r_[HAND_ZERO[:12], 1.396, HAND_ZERO[13:]])
    assert_allclose(1e3 * data.site("thumb_tip").xpos, (132, 38, -75), atol=1.0)


@pytest.mark.parametrize("mount", MOUNTS)
def test_mount_geometry(mount):
    data = placed(robot_spec(CELL.mounted(mount)).compile(), HOME)
    T = dh_frames(HOME[:7])[-1]
    palm, R = data.site("palm").xpos, T[:3, :3].T @ data.site("palm").xmat.reshape(3, 3)
    origin = T[:3, :3].T @ (palm - T[:3, 3])
    if mount == "palm_normal":
        assert_allclose(R[:, 0], (0, 0, 1), atol=1e-9)
        assert_allclose(R[:, 2], (1, 0, 0), atol=1e-9)
        assert_allclose(origin - 0.0475 * R[:, 2], (0, 0, 0.15), atol=1e-9)
    else:
        assert_allclose(R[:, 2], (0, 0, 1), atol=1e-9)
        assert_allclose(origin, (0, 0, 0.215), atol=1e-9)
        assert_allclose(R[:, 0], (np.sqrt(0.5), -np.sqrt(0.5), 0), atol=1e-9)


@pytest.mark.parametrize("mount", MOUNTS)
def test_no_contact_at_home_and_few_in_random_arm_poses(mount):
    model = robot_spec(CELL.mounted(mount)).compile()
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    assert not pairs_at(model, data, HOME)
    arms = rng.uniform(LOWER[:7], UPPER[:7], (300, 7))
    found = [pairs_at(model, data, np.concatenate([arm, HOME[7:]])) for arm in arms]
    assert np.mean([bool(pairs) for pairs in found]) < 0.15
    assert not {("palm", f"panda_link{i}") for i in (6, 7)} & set().union(*found)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_torques_saturate_at_the_limits(model, sign):
    data = placed(model, HOME)
    data.ctrl[:] = UPPER if sign > 0 else LOWER
    peak = np.zeros(23)
    for _ in range(100):
        mujoco.mj_step(model, data)
        assert (np.abs(data.actuator_force) <= TORQUE).all()
        assert (np.abs(data.qfrc_actuator) <= TORQUE + 1e-12).all()
        peak = np.maximum(peak, np.abs(data.actuator_force))
    assert (peak[7:] == 0.7).any()
    assert (peak[:7] == TORQUE[:7]).any()


@pytest.mark.parametrize("mount", MOUNTS)
def test_gravity_is_compensated_through_the_actuators(mount):
    model = robot_spec(CELL.mounted(mount)).compile()
    data = placed(model, HOME)
    start = np.array([data.site(tip).xpos for tip in TIPS])
    mujoco.mj_step(model, data, 500)
    end = np.array([data.site(tip).xpos for tip in TIPS])
    assert np.linalg.norm(end - start, axis=1).max() < 1e-3
    assert_allclose(data.qfrc_actuator, data.qfrc_bias, atol=0.05)
    assert np.abs(data.qfrc_actuator).max() > 10.0
    assert model.jnt_actgravcomp.all()
