"""The environment's page, Lift-v2's docstring, against the code; what bad input is told."""

import ast
import re
import warnings
from dataclasses import fields

import gymnasium as gym
import numpy as np
import pytest
from lift_envs import make, skip_without_gl
from refusals import refused
from tables import mistakes

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp_env.robot.cell import default_cell
from dexgrasp_env.tasks.control import CONTROL_MODES, action_size
from dexgrasp_env.tasks.lift import LiftEnv
from dexgrasp_env.tasks.observations import OBS_SUMS
from dexgrasp_env.tasks.settings import WEIGHTS, LiftSettings


def table(heading):
    """Rows of every table of a section of the class docstring."""
    section = re.search(rf"## {heading}.*?(?=\n    ## |\Z)", LiftEnv.__doc__, re.S).group(0)
    rows = [
        [cell.strip() for cell in line.strip().strip("|").split("|")]
        for line in section.splitlines()
        if "|" in line
    ]
    return [row for row in rows if not set(row[0]) <= {"-", " "} or row[0] == ""]


def test_page_lists_every_observation():
    rows = [row for row in table("Observation Space") if row[0].startswith("`")]
    for obs_mode in OBS_SUMS:
        skip_without_gl(obs_mode.removeprefix("state+"))
        env = make(obs_mode=obs_mode)
        listed = {
            row[0].strip("`"): (row[1], row[2])
            for row in rows
            if len(row) == 4 or any(f"`{mode}`" in row[3] for mode in obs_mode.split("+"))
        }
        actual = {key: (str(space.shape), str(space.dtype)) for key, space in env.observation_space.items()}
        assert listed == actual
        assert list(env.reset(seed=0)[0]) == list(actual)  # one order of keys everywhere
        env.close()


def test_page_lists_actions():
    rows = [row for row in table("Action Space") if row[0].startswith("`")]
    sizes = {mode: action_size(mode, default_cell().robot) for mode in CONTROL_MODES}
    assert {row[0].strip("`"): int(row[1]) for row in rows} == sizes
    for mode, size in sizes.items():
        assert make(control_mode=mode).action_space.shape == (size,)


def test_page_lists_rewards_and_arguments():
    rows = [row for row in table("Rewards") if row[0].startswith("`")]
    assert {row[0].strip("`"): float(row[1]) for row in rows} == WEIGHTS
    rows = [row for row in table("Arguments") if row[0].startswith("`")]
    arguments = {row[0].strip("`"): ast.literal_eval(row[1].strip("`")) for row in rows}
    assert arguments.keys() - {"robot", "mount"} == {f.name for f in fields(LiftSettings)} - {"cell"}
    assert LiftSettings.of(**arguments) == LiftSettings.of()


@pytest.mark.parametrize(("kwargs", "word"), mistakes("environments"))
def test_wrong_arguments_are_named_in_one_line(kwargs, word):
    with refused() as caught:
        LiftEnv(**{"objects": "sugar_box", **kwargs})
    assert word in str(caught.value)


def test_wrong_actions_and_options():
    env = make().unwrapped
    with refused("reset"):
        env.step(np.zeros(23))
    env.reset(seed=0)
    with refused("shape"):
        env.step(np.zeros(22))
    with refused("NaN"):
        env.step(np.full(23, np.nan))
    for options in ({"colour": 1}, {"object": "soda"}, {"object_pose": [0, 0, 1]}, {"object_pose": [0] * 7}):
        with refused():
            env.reset(options=options)
    env.reset(seed=0)
    with refused("beside state"):
        env.reset(options={"state": env.get_state(), "object": "sugar_box"})


@pytest.mark.parametrize(("position", "word"), mistakes("poses"))
def test_impossible_poses_are_refused(position, word):
    env = make().unwrapped
    if word == "in the way":
        env.reset(seed=0)
        position = env.data.site("palm").xpos.copy()
    with refused(word):
        env.reset(options={"object_pose": [*position, 1, 0, 0, 0]})
    with refused("reset"):
        env.step(np.zeros(23))


@pytest.mark.parametrize("name", ["Lift-v0", "Lift-v1", "LiftPushed-v1", "Place-v1"])
def test_withdrawn_ids_say_what_follows_them(name):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(gym.error.DeprecatedEnv, match=name.split("-")[0] + "-v2"):
            gym.make(f"DexGrasp/{name}")
