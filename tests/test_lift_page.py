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


@pytest.mark.parametrize(
    ("kwargs", "word"),
    [
        ({"obs_mode": "pixels"}, "pointcloud"),
        ({"control_mode": "torque"}, "ee_delta"),
        ({"reward_mode": "shaped"}, "sparse"),
        ({"mount": "sideways"}, "palm_normal"),
        ({"friction": float("nan")}, "friction"),
        ({"objects": "suger_box"}, "sugar_box"),
        ({"object_pose": {"z": (0, 1)}}, "yaw"),
        ({"object_pose": {"x": (0.6, 0.4)}}, "low <= high"),
        ({"object_pose": {"x": (420, 600)}}, "<= 0.87"),
        ({"object_pose": {"rest_pose": "best"}}, "likely"),
        ({"randomisation": {"mass": (-1, 1)}}, ">= 0.001"),
        ({"randomisation": {"colour": (0, 1)}}, "friction"),
        ({"randomisation": {"latency": (0, 0.2)}}, "0.05"),
        ({"presentation": "lying"}, "upright"),
        ({"disturbance": "kicked"}, "pushed"),
        ({"disturbance": {"force": 1}}, "size"),
        ({"disturbance": {"kind": "none", "size": 2}}, "leave it out"),
        ({"views": 5}, "1 to 4"),
        ({"views": ["front"]}, "front_left"),
        ({"calibration": {"position": float("nan")}}, "calibration"),
        ({"observe": "never"}, "reset"),
        ({"sensor": "perfect"}, "realistic"),
        ({"render_mode": "ascii"}, "rgb_array"),
        ({"obs_mode": "depth+pointcloud"}, "state+pointcloud"),
        ({"version": 1}, "unexpected keyword argument 'version'"),
        ({"cell": "no/such.yaml"}, "robot, mount"),
        ({"cell": 42}, "unexpected keyword argument 'cell'"),
        ({"device": "cuda:0"}, "backend='warp'"),
        ({"mesh_mass": 0.3}, "mesh_mass=0.3 changes nothing"),
        ({"control_mode": "joint_position", "action_scale": 0.5}, "whose actions are changes"),
        ({"reward_mode": "sparse", "reward_weights": {"reach": 1.0}}, "reward_mode='dense'"),
        ({"reward_weights": {"fly": 1.0}}, "reach"),
        ({"reward_weights": {"lift": -1}}, "lift"),
        ({"friction": 0.4, "randomisation": {"friction": (0.3, 0.9)}}, "a randomisation without friction"),
        ({"views": 2}, "views=2 changes nothing here: valid is an obs_mode of cameras"),
        ({"calibration": {"position": 0.02}}, "an obs_mode of cameras"),
        ({"sensor": "none"}, "an obs_mode of cameras"),
        ({"observe": "clear"}, "an obs_mode of cameras"),
        ({"render_size": (64, 48)}, "a render_mode of rgb_array"),
        ({"render_camera": "grasp"}, "a render_mode of rgb_array"),
        ({"frame_skip": 4}, "<= 125"),
        ({"frame_skip": 10, "randomisation": {"latency": (0, 0.03)}}, "0.02"),
        ({"action_scale": 2.0}, "action_scale"),
    ],
)
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
    state, pose = env.get_state(), [0.5, 0.0, 0.1, 1, 0, 0, 0]
    for beside in (
        {"object": "sugar_box"},
        {"object_pose": pose},
        {"object": "sugar_box", "object_pose": pose},
    ):
        with refused("beside state"):
            env.reset(options={"state": state, **beside})


@pytest.mark.parametrize(
    ("position", "word"),
    [
        ((0.5, 0.0, 0.01), "into the table"),
        ((3.0, 0.0, 0.05), "over the table"),
        ((0.5, 0.0, -1.0), "into the table"),
        ((0.85, 0.4, 0.05), "reach"),
        ((1e300, 0.0, 0.05), "finite"),
        ((np.nan, 0.0, 0.05), "finite"),
        ((0.5, 0.0, 0.5), "in the way"),
        (("a", 0.0, 0.05), "7 finite numbers"),
    ],
)
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
