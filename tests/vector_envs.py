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
    np.testing.assert_equal(typed(a), typed(b), where)


def typed(value):
    """Return nested values beside their types, without the keys that are told once."""
    if isinstance(value, dict):
        return {key: typed(own) for key, own in value.items() if key.removeprefix("_") not in TOLD_ONCE}
    if isinstance(value, tuple) or (isinstance(value, np.ndarray) and value.dtype == object):
        return list(map(typed, value))
    return type(value), getattr(value, "dtype", None), value
