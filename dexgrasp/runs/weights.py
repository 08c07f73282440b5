"""Weights of networks on disk, as safetensors, and the folder of a learned policy: no code is stored in either."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np

from dexgrasp_env.arrays import AnyArray, Arrays, Fields, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import check_file, expand, read_json_object, write_atomically, write_json

A = TypeVar("A")
Layer = tuple[Single, Single]
"""Weights (in, out) and biases (out,) of a linear layer."""
Weights = dict[str, Single]

SCHEMA = 1  # of the folder of a policy
ABOUT, WEIGHTS = "policy.json", "policy.safetensors"


def read_arrays(path: Path) -> tuple[Arrays, Fields]:
    """Return the arrays of a safetensors file of ours and what it says of itself.

    Raises:
        InputError: missing, too large or damaged; without safetensors.
    """
    try:
        from safetensors import SafetensorError, safe_open
    except ImportError:
        raise InputError("learned proposals need safetensors: pip install 'dexgrasp[planner]'") from None
    try:
        check_file(path)
        with safe_open(str(path), framework="np") as file:
            note = json.loads((file.metadata() or {})["dexgrasp"])
            return {name: file.get_tensor(name) for name in file.keys()}, note  # noqa: SIM118
    except FileNotFoundError:
        raise InputError(f"{path} is missing") from None
    except (OSError, SafetensorError, KeyError, json.JSONDecodeError):
        raise InputError(f"{path} is cut off or damaged, or no file of dexgrasp's") from None


def write_arrays(path: Path, arrays: Mapping[str, AnyArray], note: Fields) -> None:
    """Write arrays, and a note as JSON holds it."""
    from safetensors.numpy import save

    kept = {name: np.array(array, order="C") for name, array in arrays.items()}
    write_atomically(path, save(kept, {"dexgrasp": json.dumps(note, sort_keys=True)}))


def below(arrays: Mapping[str, A], prefix: str) -> dict[str, A]:
    """Return what has names that begin with a prefix, by the rest of these."""
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}


def through(layers: tuple[Layer, ...], x: Single, activation: Callable[[Single], Single]) -> Single:
    """Return what linear layers with an activation between them make of `x` (..., in)."""
    for k, (weight, bias) in enumerate(layers):
        x = (activation(x) if k else x) @ weight
        x += bias
    return x


def relu(x: Single) -> Single:
    """Set what is below 0 to it, in place."""
    return np.maximum(x, 0.0, out=x)


def layers_of(arrays: Arrays, name: str) -> tuple[Layer, ...]:
    """Weights, transposed, and biases of the linear layers of a module, in their order."""
    keys = sorted(
        {key.rpartition(".")[0] for key in below(arrays, f"{name}.")}, key=lambda key: int(key or 0)
    )
    prefixes = [f"{name}.{key}".rstrip(".") for key in keys]
    if not prefixes:
        raise KeyError(name)
    return tuple((np.ascontiguousarray(arrays[f"{p}.weight"].T), arrays[f"{p}.bias"]) for p in prefixes)


def is_policy(name: str) -> bool:
    """Check if an agent's name is the path of such a folder."""
    return (expand(name) / ABOUT).is_file() if name.strip("~") else False


def write_policy(folder: Path, about: Fields, arrays: Weights) -> None:
    """Write a policy; weights first, so that what is there is whole."""
    single = {name: np.asarray(array, dtype=np.float32) for name, array in arrays.items()}
    write_arrays(folder / WEIGHTS, single, {"schema": SCHEMA})
    write_json(folder / ABOUT, {"schema": SCHEMA, **about})


def read_policy(folder: Path) -> tuple[Fields, Weights]:
    """Return what a folder says of its policy, and its arrays.

    Raises:
        InputError: if something is missing, damaged, or of another schema.
    """
    path = folder / ABOUT
    missing = f"{folder} holds no policy (no {ABOUT}): train one with `dexgrasp train`"
    about = read_json_object(path, "train it again", missing, SCHEMA)
    env = about.get("env")
    keys = ("obs_mode", "control_mode", "observe", "hold")
    if not isinstance(env, dict) or any(key not in keys for key in env):
        raise InputError(f"{path}: valid keys of env are {', '.join(keys)}")
    return about, read_arrays(folder / WEIGHTS)[0]
