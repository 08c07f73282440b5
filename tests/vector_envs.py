"""The native vector environment and Gymnasium's over single ones, and what it means that they are the same."""

import gymnasium as gym
import numpy as np
from tables import table

import dexgrasp_env  # noqa: F401  (registers the environments)

ID = "DexGrasp/Lift-v2"
OBJECTS = ["sugar_box", "massage_ball", "soda"]
RANDOM = table("random_scenes")


TOLD_ONCE = {*table("told_once")}
"""Keys of a single reset's info that are of the environment, not of the episode: `SingleEnv.agent_info`."""


def native(number, env_id=ID, **kwargs):
    return gym.make_vec(env_id, num_envs=number, **{"objects": OBJECTS, **kwargs})


def singles(number, env_id=ID, autoreset_mode="NextStep", threads=None, **kwargs):
    settings = {"objects": OBJECTS, "disable_env_checker": True, **kwargs}
    return gym.make_vec(
        env_id,
        num_envs=number,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": autoreset_mode},
        **settings,
    )


def assert_same(a, b, where=""):
    """Equal in every bit, type and key."""
    if isinstance(a, dict):
        a, b = ({key: one[key] for key in one if key.removeprefix("_") not in TOLD_ONCE} for one in (a, b))
        assert set(a) == set(b), where
        for key in a:
            assert_same(a[key], b[key], f"{where}/{key}")
    elif isinstance(a, np.ndarray) and a.dtype == object:
        assert a.shape == b.shape, where
        for x, y in zip(a, b, strict=True):
            assert_same(x, y, where)
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, where
        assert np.array_equal(a, b, equal_nan=a.dtype.kind == "f"), where
    elif isinstance(a, tuple):
        for k, (x, y) in enumerate(zip(a, b, strict=True)):
            assert_same(x, y, f"{where}/{k}")
    else:
        assert type(a) is type(b), where
        assert a == b, where
