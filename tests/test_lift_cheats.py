"""What looks like lifting and is none: no success, and less reward than an honest grasp."""

import cheats
import gymnasium as gym
import numpy as np
import pytest
from lift_envs import judge
from numpy.testing import assert_allclose, assert_array_equal
from tables import table

from dexgrasp_env.scene.sensors import READINGS
from dexgrasp_env.tasks.constants import DISTURB_SHIFT, GRASP_STEPS, HOLD_STEPS
from dexgrasp_env.tasks.infos import info_of
from dexgrasp_env.tasks.settings import WEIGHTS

THRESHOLD = 75.0


def make(**kwargs):
    settings = {"objects": "gelatin_box", **kwargs}
    env = gym.make("DexGrasp/Lift-v2", **settings, disable_env_checker=True)
    env.reset(seed=0)
    return env.unwrapped


# -- what nobody earns without success --------------------------------------------------------------------------


OTHERS = [(preset, name) for preset in cheats.PRESETS[1:] for name in cheats.CHEATS]


@pytest.mark.parametrize(
    ("preset", "name"),
    [
        *(("Lift", name) for name in cheats.CHEATS),
        ("LiftPushed", "hover"),
        *(pytest.param(*one, marks=pytest.mark.slow) for one in OTHERS if one != ("LiftPushed", "hover")),
    ],
)
def test_cheats_earn_less_than_any_success(preset, name):
    """Played to the end of the episode; what each does is what it is called."""
    total, solved, infos = cheats.cheat(preset, name)
    assert not solved
    assert total < WEIGHTS["success"] < THRESHOLD == gym.spec(f"DexGrasp/{preset}-v2").reward_threshold
    highest, last = max(info["object_height"] for info in infos), infos[-1]
    if name == "hover":
        assert 0.08 < last["object_height"] < 0.10
        assert last["is_grasped"]
        assert total > 30.0  # as far as one comes
    elif name in ("press", "pin"):
        assert last["object_height"] < 0.03
        assert last["stage"] == "touched"
    else:
        assert highest > 0.3
        assert name == "throw" or max(info["held_seconds"] for info in infos) > 1.0


@pytest.mark.parametrize("preset", ["Lift", "LiftPushed"])
def test_success_earns_more_than_the_threshold(preset):
    returns = cheats.honest(preset, ["gelatin_box"], 1, 0, "hardcoded")
    assert len(returns) == 1
    assert THRESHOLD < returns[0] <= sum(WEIGHTS.values())


@pytest.mark.parametrize("mode", ["dense", "best"])
def test_reward_is_what_the_sum_of_the_terms_gains(mode):
    for weights in (None, {"lift": 40.0, "close": 0.0}):
        env = make(reward_weights=weights, reward_mode=mode)
        used = WEIGHTS | (weights or {})
        before = sum(used[name] * term for name, term in env.observe()[1]["reward_terms"].items())
        for action in np.random.default_rng(0).uniform(-1, 1, (5, 23)):
            _, reward, _, _, info = env.step(action)
            after = sum(used[name] * term for name, term in info["reward_terms"].items())
            after = max(after, before) if mode == "best" else after
            assert reward == pytest.approx(after - before, abs=1e-12)
            before = after


def test_success_stays_and_failure_takes_the_rest():
    env = make()
    terms = held(env, HOLD_STEPS)[-1][0]["reward_terms"]
    assert terms["success"] == 1.0
    env.data.qpos[25], env.data.qpos[24] = 0.0, 2.0  # let fall, and lost
    judge(env)
    terms = info_of(env._episodes, 0)["reward_terms"]
    assert terms.pop("success") == 1.0
    assert set(terms.values()) == {0.0}


@pytest.mark.parametrize("frame_skip", [5, 10, 50, 110])
def test_seconds_are_seconds_at_any_pace(frame_skip):
    env = make(frame_skip=frame_skip, disturbance="pushed")
    steps = int(np.ceil(1500 / frame_skip))
    assert env.dt == pytest.approx(0.002 * frame_skip)
    wait = int(np.ceil(500 / frame_skip))
    seen = [info for info, _ in held(env, wait + env.disturbance_steps + steps)]
    assert [info["is_success"] for info in seen[-2:]] == [False, True]
    assert seen[-1]["held_seconds"] == pytest.approx(3.0, abs=env.dt)
    assert env.disturbance_steps * env.dt == pytest.approx(4.0, abs=11 * env.dt)


PRESSED, LOOSE = table("pressed"), table("loose")


# -- readings that stand for what the hand does -----------------------------------------------------------------


def held(env, steps, *, any_contacts=2, hand_contacts=2, forces=None):
    """Let the kernel judge `steps` moments with the object at height and given contacts; return infos and rewards."""
    episodes, simulation = env._episodes, env.simulation
    at = dict(zip(READINGS, simulation.columns, strict=True))
    forces = np.array(PRESSED if forces is None else forces, float)
    data = simulation.data
    data.qpos[25] = 0.4
    for name in ("tip_forces", "finger_forces"):
        data.sensordata[at[name] : at[name] + 12] = forces.ravel()
    data.sensordata[at["touching_any"]], data.sensordata[at["touching_hand"]] = any_contacts, hand_contacts
    seen = []
    for _ in range(steps):
        judge(env)
        seen.append((info_of(env._episodes, 0), float(episodes.rewards[0])))
    return seen


def test_pinned_or_wedged_objects_are_not_held():
    """Something beside the hand touches the object: the arm it is pinned to, the table it is wedged against."""
    seen = held(make(), HOLD_STEPS + 5, any_contacts=3, forces=LOOSE)
    assert not any(info["is_success"] or info["held_seconds"] > 0 for info, _ in seen)
    assert {info["reward_terms"][name] for info, _ in seen for name in ("lift", "hold")} == {0.0}


@pytest.mark.parametrize(("forces", "grasped"), table("opposed"))
def test_grasp_needs_opposed_forces(forces, grasped):
    info, _ = held(make(), 1, forces=forces)[0]
    assert info["is_grasped"] is grasped


def test_nine_tenths_of_the_hold_must_be_grasped():
    env = make()
    held(env, HOLD_STEPS - GRASP_STEPS, forces=LOOSE)
    assert held(env, GRASP_STEPS)[-1][0]["is_success"]
    env = make()
    held(env, HOLD_STEPS - GRASP_STEPS + 1, forces=LOOSE)
    assert [info["is_success"] for info, _ in held(env, GRASP_STEPS)][-2:] == [False, True]
    assert not held(env, 1, forces=LOOSE)[0][0]["is_success"]  # nor without a grasp at its end


# -- disturbances -----------------------------------------------------------------------------------------------


def test_pushes_are_of_the_weight_in_six_directions_after_a_second():
    env = make(disturbance={"kind": "pushed", "size": 0.5}, mass=2.0)
    weight = env._episodes.records["mass"][0] * 9.81
    assert all(info["disturbance"] == "before" for info, _ in held(env, 19))
    pushes = []
    for _ in range(env.disturbance_steps + 1):
        info, _ = held(env, 1)[0]
        _, push = env._episodes.set_points(np.zeros((1, 23)), env.simulation)
        pushes.append(push[0].copy() if info["disturbance"] == "running" else None)
    assert pushes[-1] is None
    pushes = np.array(pushes[:80]) / weight
    on = np.abs(pushes).sum(1) > 0
    assert on.sum() == 60
    assert_allclose(np.abs(pushes[on]).sum(1), 0.5)
    assert_array_equal(np.sign(pushes[: 6 * 14 : 14]), np.kron(np.eye(3), [[1], [-1]]))


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
        rows, _ = env._episodes.set_points(np.zeros((1, 23)), env.simulation)
        offsets.append(rows[0, -1] - env.targets)
        held(env, 1)
    offsets, t = np.array(offsets), 0.05 * np.arange(1, 41)
    assert_allclose(offsets[:40, 0], 0.06 * np.sin(2 * np.pi * 3 * t), atol=1e-12)
    expected = 0.04 * (np.sin(2 * np.pi * 2.4 * t + 1) - np.sin(1))
    assert_allclose(offsets[:40, 3], expected, atol=1e-12)
    assert np.abs(np.delete(offsets, [0, 3], axis=1)).max() == 0
    assert np.abs(offsets[40]).max() == 0
