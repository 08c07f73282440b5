"""Attributes and calls of a native vector environment, as Gymnasium's own ones have them."""

import numpy as np
import pytest
import trimesh
from gymnasium.vector import AutoresetMode
from refusals import refused
from vector_envs import native, singles


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
    with pytest.raises(AttributeError, match="valid are target, "):
        ours.get_attr("speed")
    with refused("3 values given"):
        ours.set_attr("level", [1, 2, 3])


def test_no_limit_in_gymnasiums_word_and_closed_environments_say_so():
    envs = native(2, objects="sugar_box", max_episode_steps=-1)
    envs.reset(seed=0)
    assert not envs.step(np.zeros((2, 23)))[3].any()
    envs.close()
    for what in (envs.reset, lambda: envs.step(np.zeros((2, 23))), envs.render, envs.get_state):
        with refused("closed"):
            what()


def test_a_path_is_an_object_as_its_text_is(tmp_path):
    path = tmp_path / "part.stl"
    trimesh.creation.box((0.06, 0.05, 0.08)).export(path)
    assert native(1, objects=[path, "soda"]).unwrapped.settings.objects == (str(path), "soda")
    assert native(1, objects=path).unwrapped.settings.objects == (str(path),)
