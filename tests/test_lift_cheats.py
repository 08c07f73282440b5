"""What looks like lifting and is none: no success, and less reward than an honest grasp."""

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from robots import HOME, LOWER, UPPER

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp_env.scene.sensors import READINGS
from dexgrasp_env.tasks.constants import DISTURB_SHIFT, GRASP_STEPS, HOLD_STEPS

HONEST = 0.95  # dense reward a step of a grasp that is held


def make(**kwargs):
    env = gym.make("DexGrasp/Lift-v1", **{"objects": "gelatin_box", **kwargs}, disable_env_checker=True)
    env.reset(seed=0)
    return env.unwrapped


def put(env, q, pose, velocity=0.0):
    """Make the episode one in which the robot stands at `q` and the object is at `pose`."""
    state = env.get_state()
    state.physics[1:24], state.physics[24:31] = q, pose
    state.physics[31:60] = 0.0
    state.physics[31 + 25] = velocity
    state.commands[:] = q
    env.set_state(state)


def upturned_hand(env):
    """A posture with the open palm up, high above the table and free of collisions."""
    model, data, rng = env.model, mujoco.MjData(env.model), np.random.default_rng(0)
    best, score = HOME.copy(), -np.inf
    for _ in range(6000):
        q = HOME.copy()
        q[:7] = rng.uniform(LOWER[:7], UPPER[:7])
        data.qpos[:23], data.qpos[23:26] = q, [0.5, 0.5, 0.02]
        mujoco.mj_kinematics(model, data)
        site = data.site("palm")
        up, height = site.xmat.reshape(3, 3)[2, 0], site.xpos[2]
        if up > max(score, 0.99) and 0.3 < height < 0.7:
            mujoco.mj_forward(model, data)
            if not any(min(c.geom) >= 0 and c.dist < 0 and data.qpos[24] < 0.5 for c in data.contact):
                best, score = q, up
    assert score > 0.99
    return best


def test_tray_is_no_grasp():
    """The object laid on the upturned open hand, held still for more than 3 s."""
    env = make(control_mode="joint_delta")
    q = upturned_hand(env)
    q[7:] = 0.0
    q[19:] = [0.263, -0.105, -0.189, -0.162]  # the thumb out of the way
    data = mujoco.MjData(env.model)
    data.qpos[:23] = q
    mujoco.mj_kinematics(env.model, data)
    palm = data.site("palm")
    place = palm.xpos + palm.xmat.reshape(3, 3) @ [0.045, 0.0, 0.02]
    put(env, q, [*place, 1, 0, 0, 0])
    rewards, infos = [], []
    for _ in range(90):
        _, reward, _, _, info = env.step(np.zeros(23))
        rewards.append(reward)
        infos.append(info)
    assert max(info["held_seconds"] for info in infos) > 3.0, "the tray did not even hold the object"
    assert not any(info["is_success"] for info in infos)
    assert not any(info["is_grasped"] for info in infos)
    assert all(info["reward_terms"]["lift"] == 0.0 for info in infos)
    assert max(rewards) < 0.5 * HONEST


def test_flinging_is_no_lift():
    env = make()
    pose = env.data.qpos[23:30].copy()
    put(env, HOME, [*(pose[:3] + np.array([0, 0.15, 0.05])), *pose[3:]], velocity=3.0)
    heights, rewards, success = [], [], False
    for _ in range(40):
        _, reward, terminated, _, info = env.step(np.zeros(23))
        heights.append(info["object_height"])
        rewards.append(reward)
        success = success or info["is_success"]
        if terminated:
            break
    assert max(heights) > 0.3
    assert not success
    assert max(rewards) < 0.5 * HONEST


# -- readings that stand for what the hand does -----------------------------------------------------------------


def held(env, steps, *, any_contacts=2, hand_contacts=2, forces=None):
    """Let the kernel judge `steps` moments with the object at height and given contacts; return infos and rewards."""
    episodes, simulation = env._episodes, env.simulation
    at = dict(zip(READINGS, simulation.columns, strict=True))
    opposed = np.array([[2.0, 0, 0], [0, 0, 0], [0, 0, 0], [-2.0, 0, 0]])
    forces = opposed if forces is None else np.asarray(forces, float)
    data = simulation.data
    data.qpos[25] = 0.4
    for name in ("tip_forces", "finger_forces"):
        data.sensordata[at[name] : at[name] + 12] = forces.ravel()
    data.sensordata[at["touching_any"]], data.sensordata[at["touching_hand"]] = any_contacts, hand_contacts
    seen = []
    for _ in range(steps):
        env._conclude(0)
        seen.append((env._episodes.info(0), float(episodes.rewards[0])))
    return seen


def test_honest_grasp_is_a_success_after_three_seconds():
    seen = held(make(), HOLD_STEPS + 1)
    assert [info["is_success"] for info, _ in seen].index(True) == HOLD_STEPS - 1
    assert seen[-1][1] > 0.8  # the rest is the fingers' nearness, which the readings leave out


def test_pinned_or_wedged_objects_are_not_held():
    """Something beside the hand touches the object: the arm it is pinned to, the table it is wedged against."""
    honest = held(make(), HOLD_STEPS + 5)[-1][1]
    one_sided = [[0, 0, 2.0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    seen = held(make(), HOLD_STEPS + 5, any_contacts=3, forces=one_sided)
    assert not any(info["is_success"] or info["held_seconds"] > 0 for info, _ in seen)
    assert max(reward for _, reward in seen) < 0.5 * honest


@pytest.mark.parametrize(
    ("forces", "grasped"),
    [
        ([[0.6, 0, 0], [0, 0, 0], [0, 0, 0], [-0.6, 0, 0]], True),
        ([[0, 0, 0], [0, 0, 0], [0.6, 0, 0], [-0.6, 0.3, 0]], True),
        ([[0.4, 0, 0], [0.4, 0, 0], [0.4, 0, 0], [-2, 0, 0]], False),  # too weak each
        ([[2, 0, 0], [2, 0, 0], [2, 0, 0], [-0.4, 0, 0]], False),  # the thumb too weak
        ([[0, 0, 2], [0, 0, 2], [0, 0, 2], [0, 0.1, 2]], False),  # a tray
        ([[2, 0, 0], [-2, 0, 0], [0, 0, 0], [0, 0, 0]], False),  # without the thumb
    ],
)
def test_grasp_needs_opposed_forces(forces, grasped):
    info, _ = held(make(), 1, forces=forces)[0]
    assert info["is_grasped"] is grasped


def test_nine_tenths_of_the_hold_must_be_grasped():
    loose = [[0, 0, 2.0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    env = make()
    held(env, HOLD_STEPS - GRASP_STEPS, forces=loose)
    assert held(env, GRASP_STEPS)[-1][0]["is_success"]
    env = make()
    held(env, HOLD_STEPS - GRASP_STEPS + 1, forces=loose)
    seen = held(env, GRASP_STEPS)
    assert [info["is_success"] for info, _ in seen][-2:] == [False, True]
    assert not held(env, 1, forces=loose)[0][0]["is_success"]  # nor without a grasp at its end


# -- disturbances -----------------------------------------------------------------------------------------------


def test_pushes_are_of_the_weight_in_six_directions_after_a_second():
    env = make(disturbance={"kind": "pushed", "size": 0.5}, mass=2.0)
    weight = env._episodes.records["mass"][0] * 9.81
    assert all(info["disturbance"] == "before" for info, _ in held(env, 19))
    pushes = []
    for _ in range(env.disturbance_steps + 1):
        info, _ = held(env, 1)[0]
        _, push = env._episodes.set_points(slice(None), np.zeros((1, 23)))
        pushes.append(push[0].copy() if info["disturbance"] == "running" else None)
    assert pushes[-1] is None
    pushes = np.array(pushes[:80]) / weight
    on = np.abs(pushes).sum(1) > 0
    assert on.sum() == 60
    np.testing.assert_allclose(np.abs(pushes[on]).sum(1), 0.5)
    assert [tuple(np.sign(pushes[14 * k])) for k in range(6)] == [
        (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1),
    ]  # fmt: skip


@pytest.mark.parametrize(("shift", "success"), [(0.9 * DISTURB_SHIFT, True), (1.1 * DISTURB_SHIFT, False)])
def test_success_after_the_disturbance_needs_the_object_in_place(shift, success):
    env = make(disturbance="shaken")
    infos = [info for info, _ in held(env, 20 + env.disturbance_steps)]
    assert infos[-1]["disturbance"] == "over"
    assert not any(info["is_success"] for info in infos)
    env.data.qpos[24] += shift
    seen = held(env, HOLD_STEPS)
    assert [info["is_success"] for info, _ in seen] == [False] * (HOLD_STEPS - 1) + [success]
    assert seen[-1][0]["object_shift"] == pytest.approx(shift, abs=1e-9)


def test_shaking_moves_the_arm_and_not_the_agents_set_points():
    env = make(disturbance="shaken")
    held(env, 20)
    offsets = []
    for _ in range(41):
        rows, _ = env._episodes.set_points(slice(None), np.zeros((1, 23)))
        offsets.append(rows[0, -1] - env.targets)
        held(env, 1)
    offsets, t = np.array(offsets), 0.05 * np.arange(1, 41)
    np.testing.assert_allclose(offsets[:40, 0], 0.06 * np.sin(2 * np.pi * 3 * t), atol=1e-12)
    expected = 0.04 * (np.sin(2 * np.pi * 2.4 * t + 1) - np.sin(1))
    np.testing.assert_allclose(offsets[:40, 3], expected, atol=1e-12)
    assert np.abs(np.delete(offsets, [0, 3], axis=1)).max() == 0
    assert np.abs(offsets[40]).max() == 0
