"""The native vector environment against single ones: the same bits, whatever ends when, on any number of threads."""

import copy
import pickle
import sys

import gymnasium as gym
import numpy as np
import pytest
from refusals import refused
from tables import mistakes, table
from vector_envs import ID, OBJECTS, RANDOM, assert_same, native, singles


def actions(rng, envs, centre):
    return np.clip(centre + rng.normal(0, 0.5, centre.shape), -1, 1).astype(np.float32)


def compare(number, steps, mode="NextStep", **kwargs):
    """Step both with the same actions, and return how many episodes ended early and by the time limit."""
    limit = kwargs.pop("max_episode_steps", 17)
    ours = native(number, autoreset_mode=mode, max_episode_steps=limit, **kwargs)
    theirs = singles(number, autoreset_mode=mode, max_episode_steps=limit, **kwargs)
    seeds = [7 * i + 1 for i in range(number)]
    assert_same(theirs.reset(seed=seeds), ours.reset(seed=seeds), "reset")
    rng = np.random.default_rng(0)
    centre = rng.uniform(-1, 1, ours.action_space.shape)
    lost, truncated, ages = 0, 0, np.zeros(number, int)
    for step in range(steps):
        act = actions(rng, ours, centre)
        a, b = theirs.step(act), ours.step(act)
        assert_same(a, b, f"step {step}")
        over, ages = a[2] | a[3], ages + 1
        lost, truncated = lost + int((over & (ages < limit)).sum()), truncated + int((ages >= limit).sum())
        ages[over] = -1 if mode == "NextStep" else 0  # the next step resets, or is their first
        if mode == "Disabled" and over.any():
            options = {"reset_mask": over}
            assert_same(
                theirs.reset(options=dict(options)), ours.reset(options=dict(options)), f"masked {step}"
            )
        if step % 11 == 5:  # thrown off the table, in one of them
            i = step % number
            throw(ours, theirs, i)
    ours.close()
    theirs.close()
    return lost, truncated


def throw(ours, theirs, i):
    """Let the object of environment `i` fly away, in both."""
    inner = theirs.envs[i].unwrapped
    if inner._over:
        return
    state = inner.get_state()
    assert_same(state.physics, ours.get_state(i).physics, "physics")
    state.physics[1 + 24] = 0.64  # time, then positions: the object's y
    state.physics[1 + 30 + 24] = 2.0  # and its velocity
    inner.set_state(state)
    ours.set_state(state, [i])


@pytest.mark.parametrize(("name", "mode", "number", "steps", "settings"), table("vectors"))
def test_equals_single_environments_bit_for_bit(name, mode, number, steps, settings):
    """Where there is time for it objects are thrown away, and episodes end by their limit."""
    lost, truncated = compare(number, steps, mode, env_id=f"DexGrasp/{name}", **settings)
    assert steps < 60 or (lost >= 1 and truncated >= 3)


def test_place_truncates_what_is_lost():
    """Rewards are 0 at most: were it an end, it would pay to throw the object away."""
    ours, theirs = (
        make(2, env_id="DexGrasp/Place-v2", autoreset_mode="SameStep") for make in (native, singles)
    )
    ours.reset(seed=3)
    theirs.reset(seed=3)
    throw(ours, theirs, 1)
    for _ in range(5):
        a, b = theirs.step(np.zeros((2, 23))), ours.step(np.zeros((2, 23)))
        assert_same(a, b)
        if (b[2] | b[3]).any():
            break
    assert b[4]["final_info"]["failure"][1] == "object_lost"
    assert b[2].tolist() == [False, False]
    assert b[3].tolist() == [False, True]


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("value", [1e12, np.nan])
def test_numbers_that_go_wrong_are_told_alike_and_once(mode, value):
    ours, theirs = native(2, autoreset_mode=mode), singles(2, autoreset_mode=mode)
    ours.reset(seed=3)
    theirs.reset(seed=3)
    state = ours.get_state(1)
    state.physics[1 + 30 + 24] = value  # time, positions, then velocities: the object's y
    theirs.envs[1].unwrapped.set_state(state)
    ours.set_state(state, [1])
    for step in range(4):
        a, b = theirs.step(np.zeros((2, 23))), ours.step(np.zeros((2, 23)))
        assert_same(a, b, f"step {step}")
        assert b[2].tolist() == [False, step == 0]
        assert step > 0 or -5.0 < b[1][1] <= 0.0  # what had been earned is lost


@pytest.mark.parametrize("obs_mode", ["state", "pointcloud"])
def test_deepcopy_and_pickle_keep_the_episode(obs_mode):
    looks = {} if obs_mode == "state" else {"observe": "reset"}
    env = gym.make(ID, objects=OBJECTS, randomisation=RANDOM, obs_mode=obs_mode, max_episode_steps=9, **looks)
    env.reset(seed=4)
    rng = np.random.default_rng(0)
    for _ in range(3):
        env.step(rng.uniform(-1, 1, 23))
    others = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    for _ in range(6):
        act = rng.uniform(-1, 1, 23)
        expected = env.step(act)
        for other in others:
            assert_same(expected, other.step(act))
    assert expected[3]  # the time limit's wrapper was copied with its count
    expected = env.reset()
    for other in others:
        assert_same(expected, other.reset())


def test_episodes_begin_at_a_state():
    """With what it had achieved, a clock of their own, and the generator's next draws."""
    single = gym.make(
        ID, objects=OBJECTS, randomisation=RANDOM, disable_env_checker=True, max_episode_steps=9
    )
    envs = native(3, randomisation=RANDOM, max_episode_steps=9)
    acts = np.random.default_rng(1).uniform(-0.5, 0.5, (9, 23))
    single.reset(seed=0)
    for act in acts[:4]:
        last = single.step(act)
    state = single.unwrapped.get_state()
    noiseless = {key: value for key, value in last[0].items() if key != "joint_positions"}
    seen, info = single.unwrapped.observe()
    assert_same(noiseless, {key: seen[key] for key in noiseless})
    assert_same(last[4], info)
    seen, info = single.reset(seed=5, options={"state": state})
    assert_same(noiseless, {key: seen[key] for key in noiseless})
    assert_same(last[4], info)
    many, _ = envs.reset(seed=5, options={"state": [state] * 3})
    assert all(np.array_equal(many[key][0], seen[key]) for key in seen)
    for k, act in enumerate(acts):
        alone, together = single.step(act), envs.step(np.tile(act, (3, 1)))
        assert all(np.array_equal(together[0][key][0], alone[0][key]) for key in seen)
        assert together[1][0] == alone[1]
        assert alone[3] == together[3][0] == (k == 8)
    with refused("2 states"):
        envs.reset(options={"state": [state] * 2})


@pytest.mark.parametrize(("settings", "word"), mistakes("states"))
def test_states_of_other_settings_are_refused_in_one_line(settings, word):
    env = gym.make(ID, objects="sugar_box", disable_env_checker=True)
    env.reset(seed=0)
    state = env.unwrapped.get_state()
    other = gym.make(
        **{"id": settings.pop("env_id", ID), "objects": "sugar_box", "disable_env_checker": True, **settings}
    )
    other.reset(seed=0)
    for use in (other.unwrapped.set_state, lambda s: other.unwrapped.reset(options={"state": s})):
        with refused(word):
            use(state)


def test_what_cameras_have_not_seen_is_not_left_out_of_a_reset():
    first = {"reset_mask": np.array([True, False])}
    envs = native(2, objects="sugar_box", obs_mode="depth", views=1)
    with refused(r"\[1\]"):
        envs.reset(seed=0, options=first)
    envs.reset(seed=0)
    _, infos = envs.reset(options=first)
    assert infos["_object"].tolist() == [True, False]
    envs.close()


def test_wrong_use_is_named_in_one_line():
    for kwargs, word in mistakes("vectors"):
        with refused(word):
            native(2, **kwargs)
    envs = native(2, objects="sugar_box", autoreset_mode="Disabled", max_episode_steps=1)
    with refused("reset"):
        envs.step(np.zeros((2, 23)))
    with refused("reset_mask"):
        envs.reset(options={"reset_mask": np.zeros(2, bool)})
    envs.reset(seed=0)
    with refused("shape"):
        envs.step(np.zeros((3, 23)))
    with refused(r"\[\[1, 4\]\]"):
        envs.step(np.where(np.arange(46).reshape(2, 23) == 27, np.nan, 0.0))
    envs.step(np.zeros((2, 23)))
    with refused(r"\[0, 1\]"):
        envs.step(np.zeros((2, 23)))


@pytest.mark.parametrize(("settings", "words"), mistakes("backends"))
def test_what_no_physics_can_do_is_refused_in_one_line(settings, words):
    with refused(words):
        native(2, **settings)


def test_the_extra_of_the_gpu_is_named_where_it_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "warp", None)
    monkeypatch.delitem(sys.modules, "dexgrasp_env.tasks.warp_batch", raising=False)
    with refused(r"warp is not installed: pip install 'dexgrasp\[gpu\]'"):
        native(2, backend="warp")


def test_models_of_objects_left_behind_are_given_back():
    """Each is several MB: at most one of its own for each environment, however many objects it has met."""
    envs = native(3, randomisation=RANDOM, max_episode_steps=1, autoreset_mode="SameStep")
    envs.reset(seed=0)
    met = set()
    for _ in range(12):
        *_, infos = envs.step(np.zeros((3, 23)))
        met |= set(infos["object"])
    shared = {id(simulation.base) for simulation in envs._episodes.simulations.values()}
    own = {id(model) for group in envs._physics._groups.values() for model in group.models} - shared
    assert met == set(OBJECTS)
    assert len(own) <= envs.num_envs
    envs.close()
