"""A learned policy on disk: a folder of `policy.json` and `policy.safetensors`, nothing that runs when it is read."""

from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.runs.arrays import read_arrays, write_arrays
from dexgrasp_env.arrays import Fields, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import expand, read_json_object, write_json

SCHEMA = 1
ABOUT, WEIGHTS = "policy.json", "policy.safetensors"
Weights = dict[str, Single]


def is_policy(name: str) -> bool:
    """Check if an agent's name is the path of such a folder."""
    return (expand(name) / ABOUT).is_file() if name.strip("~") else False


def policy_files(name: str) -> list[Path]:
    """Return the files that such an agent's outcomes rest on."""
    return [expand(name) / ABOUT, expand(name) / WEIGHTS]


def write_policy(folder: Path, about: Fields, arrays: Weights) -> None:
    """Write a policy; weights first, so that what is there is whole."""
    single = {name: np.asarray(array, dtype=np.float32) for name, array in arrays.items()}
    write_arrays(folder / WEIGHTS, single, {"schema": SCHEMA})
    write_json(folder / ABOUT, {"schema": SCHEMA, **about})


def read_policy(folder: Path) -> tuple[dict[str, Any], Weights]:
    """Return what a folder says of its policy, and its arrays.

    Raises:
        InputError: if something is missing, damaged, or of another schema.
    """
    path = folder / ABOUT
    missing = f"{folder} holds no policy (no {ABOUT}): train one with `dexgrasp train`"
    about = read_json_object(path, "train it again", missing)
    if about.get("schema") != SCHEMA:
        raise InputError(f"{path} is no policy of schema {SCHEMA}")
    env = about.get("env")
    keys = ("obs_mode", "control_mode", "observe", "hold")
    if not isinstance(env, dict) or any(key not in keys for key in env):
        raise InputError(f"{path}: valid keys of env are {', '.join(keys)}")
    return about, read_arrays(folder / WEIGHTS)[0]
