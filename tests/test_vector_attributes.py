"""Attributes and calls of a native vector environment, as Gymnasium's own ones have them."""

import inspect
from functools import partial

import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from lift_envs import few, skip_without_gl
from refusals import refused
from tables import mistakes
from vector_envs import assert_same, native, singles

from dexgrasp_env.tasks.clutter import ClutterEnv
from dexgrasp_env.tasks.lift import LiftEnv
from dexgrasp_env.tasks.observations import OBS_MODES
from dexgrasp_env.tasks.place import PlaceEnv
from dexgrasp_env.tasks.vector import ClutterVectorEnv, LiftVectorEnv, PlaceVectorEnv

OF_SYNC = {"env_fns", "envs", "copy", "observation_mode"}
"""Of how `SyncVectorEnv` is made of single environments."""
TOGETHER = {"step", "start_from", "close"}
"""What environments that are side by side do together, with `step` and others of the vector environment."""
OF_THE_CLASS = {"episodes_type", "settings_type"}
OF_WRAPPERS = {"get_wrapper_attr", "has_wrapper_attr", "set_wrapper_attr"}


def public(kind):
    return {name for name in dir(kind) if not name.startswith("_")}


def test_nothing_is_missing_that_gymnasiums_own_has():
    theirs, ours = singles(2), native(2)
    names = public(theirs) - OF_SYNC
    assert {name for name in names if not hasattr(ours, name)} == set()
    for name in names:
        if inspect.isroutine(inspect.getattr_static(SyncVectorEnv, name, None)):
            wanted, got = (inspect.signature(getattr(envs, name)).parameters for envs in (theirs, ours))
            assert [(p.name, p.kind, p.default) for p in wanted.values()] == [
                (p.name, p.kind, p.default) for p in got.values()
            ], name
    assert set(theirs.metadata) <= set(ours.metadata)
    for envs in (ours, theirs):
        envs.reset(seed=[4, 9])
    assert ours.np_random_seed == theirs.np_random_seed == (4, 9)
    drawn = [[rng.random() for rng in envs.np_random] for envs in (ours, theirs)]
    assert drawn[0] == drawn[1]


@pytest.mark.parametrize(
    ("vector", "single"),
    [(LiftVectorEnv, LiftEnv), (ClutterVectorEnv, ClutterEnv), (PlaceVectorEnv, PlaceEnv)],
)
def test_each_has_the_attributes_of_a_single_environment(vector, single):
    envs = vector(2, objects="soda", **few(single.__name__))
    envs.reset(seed=0)
    other = single(objects="soda", **few(single.__name__))
    other.reset(seed=1)
    names = public(single) | {name for name in vars(other) if not name.startswith("_")}
    names -= TOGETHER | OF_THE_CLASS | OF_WRAPPERS | public(envs.members[1])
    assert {name for name in names if not hasattr(envs.members[1], name)} == set()
    assert_same(envs.call("observe")[1][0], other.observe()[0])
    assert np.array_equal(envs.get_attr("simulation")[1].data.qpos, other.simulation.data.qpos)


@pytest.mark.parametrize("obs_mode", OBS_MODES)
def test_every_mode_is_that_of_gymnasiums_own(obs_mode):
    """Objects and sizes of each its own: what draws them is made for each."""
    skip_without_gl(obs_mode)
    settings = {"obs_mode": obs_mode, "objects": ["soda", "pear"]} | (
        {} if obs_mode == "state" else {"views": 2}
    )
    settings["randomisation"] = {"size": (0.8, 1.1)}
    both = native(2, **settings), singles(2, **settings)
    assert both[0].single_observation_space == both[1].single_observation_space
    assert_same(*(envs.reset(seed=3) for envs in both))
    for _ in range(2):
        assert_same(*(envs.step(np.full((2, 23), 0.3)) for envs in both))
    for envs in both:
        envs.close()


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_attributes_of_each_are_those_of_gymnasiums_own(mode):
    ours, theirs = native(2, autoreset_mode=mode), singles(2, autoreset_mode=mode)
    assert ours.autoreset_mode == theirs.autoreset_mode == mode == ours.metadata["autoreset_mode"]
    for envs in (ours, theirs):
        envs.reset(seed=0)
    for name in ("dt", "target", "render_mode", "disturbance_steps", "action_space"):
        assert ours.get_attr(name) == ours.call(name) == theirs.get_attr(name)
    positions = [[data.qpos for data in envs.get_attr("data")] for envs in (ours, theirs)]
    assert np.array_equal(*positions)
    assert not np.array_equal(*positions[0])
    states = ours.call("get_state")
    assert [state.target for state in states] == list(ours.get_attr("target"))
    for envs in (ours, theirs):
        envs.set_attr("level", [1, 2])
        assert envs.get_attr("level") == (1, 2)
        envs.set_attr("level", 3)
        assert envs.get_attr("level") == (3, 3)
    with pytest.raises(AttributeError, match="other arguments"):
        ours.set_attr("dt", 0.1)
    with pytest.raises(AttributeError, match=r"valid are .*target"):
        ours.get_attr("speed")
    with refused("3 values given"):
        ours.set_attr("level", [1, 2, 3])


def test_no_limit_in_gymnasiums_word_and_closed_environments_say_so():
    envs = native(2, objects="sugar_box", max_episode_steps=-1)
    envs.reset(seed=0)
    assert not envs.step(np.zeros((2, 23)))[3].any()
    state = envs.get_state()
    with refused("environment is 2"):
        envs.set_state(state, [2])
    envs.close()
    step, put = partial(envs.step, np.zeros((2, 23))), partial(envs.set_state, state)
    for what in (envs.reset, step, envs.render, envs.get_state, put):
        with refused("closed"):
            what()
        with pytest.raises(ClosedEnvironmentError):
            what()


def test_seeds_and_options_are_checked_in_words():
    envs = native(2)
    first, _ = envs.reset(seed=np.array([3, 4]))
    assert_same(first, envs.reset(seed=3)[0])
    for what, words in mistakes("resets"):
        with refused(words):
            envs.reset(**what)
