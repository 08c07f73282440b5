"""Every argument of every environment changes something, or is refused."""

import dataclasses
import importlib

import gymnasium as gym
import numpy as np
import pytest
import trimesh
from lift_envs import few
from tables import table

import dexgrasp_env  # registers the environments
from dexgrasp_env.rendering import choose_gl

IDS = sorted(name for name in gym.registry if name.startswith("DexGrasp/"))
OTHER, THIRD, BESIDE = map(table, ("other_values", "third_values", "beside"))

DRAWN = {"render_size", "render_camera"}
ELSEWHERE = {"backend", "starts"}  # in the tests of the extra gpu, and of starts
QUICK = {"DexGrasp/Lift-v2"}
OWN_OF_CLUTTER = {"neighbours", "neighbour_objects", "gaps", "mask", "bin"}


def arguments(env_id):
    """Default of what an environment takes, by name."""
    module, _, kind = gym.spec(env_id).entry_point.partition(":")
    fields = dataclasses.fields(getattr(importlib.import_module(module), kind).settings_type)
    known = {field.name: field.default for field in fields if field.name != "cell"} | {
        "robot": None,
        "mount": None,
    }
    return {name: known[name] for name in sorted(known)}


def tries():
    for env_id in IDS:
        for name in arguments(env_id):
            quick = env_id in QUICK or (name in OWN_OF_CLUTTER and "Sparse" in env_id)
            yield pytest.param(env_id, name, marks=[] if quick else [pytest.mark.slow], id=f"{env_id}-{name}")


def told(part):
    """A value in which equal things are equal: what an agent is told of its settings is left out."""
    if isinstance(part, dict):
        return {
            key: told(value)
            for key, value in part.items()
            if key not in ("cell", "action_space", "mount", "observe")
        }
    if isinstance(part, np.ndarray):
        return part.dtype.str, part.shape, part.tobytes()
    return [told(each) for each in part] if isinstance(part, list | tuple) else repr(part)


def outcome(env_id, draw, **settings):
    """All that an environment says of itself, of a reset and of twelve steps."""
    env = gym.make(env_id, disable_env_checker=True, **settings)
    seen = [env.observation_space, env.action_space, env.render_mode, env.reset(seed=3)]
    seen += [env.unwrapped.disturbance_steps]  # it begins once something is held
    rng = np.random.default_rng(0)
    seen += [env.step(rng.uniform(-1, 1, env.action_space.shape)) for _ in range(12)]
    seen += [env.render()] if draw else []
    env.close()
    return told(seen)


def effect(env_id, name, known, value):
    """Whether a value of an argument changes anything, or what it is refused with."""
    try:
        changed = outcome(env_id, name in DRAWN, **known | {name: value})
    except dexgrasp_env.InputError as error:
        return str(error)
    return "nothing" if changed == outcome(env_id, name in DRAWN, **known) else "changes"


@pytest.mark.parametrize(("env_id", "name"), list(tries()))
def test_an_argument_changes_something_or_is_refused(env_id, name, tmp_path):
    if name in DRAWN and choose_gl() is None:
        pytest.skip("no GL library here")
    if name in ELSEWHERE:
        return
    assert name in OTHER, "give it another value, in OTHER"
    trimesh.creation.box((0.06, 0.05, 0.08)).export(tmp_path / "part.stl")
    mesh = str(tmp_path / "part.stl")
    base = {"objects": "sugar_box", **few(env_id), **BESIDE.get(name, {})}
    base |= {"objects": mesh} if base["objects"] == "MESH" else {}
    known = {key: value for key, value in base.items() if key in arguments(env_id)}
    given = arguments(env_id) | gym.spec(env_id).kwargs | known
    value = THIRD[name] if given[name] == OTHER[name] else OTHER[name]
    said = effect(env_id, name, known, value)
    assert said == "changes" or name in said or "pre-grasps of none" in said


def test_the_same_arguments_change_nothing():
    assert outcome("DexGrasp/Lift-v2", False, objects="soda") == outcome(
        "DexGrasp/Lift-v2", False, objects="soda"
    )
