"""Weights and checkpoints as safetensors: arrays and text, nothing that runs when it is read."""

import json
from pathlib import Path
from typing import Any

from dexgrasp.cvae.network import Cvae
from dexgrasp.planning.decoder import SCHEMA, NetworkSettings, wrong_schema
from dexgrasp.runs.arrays import read_arrays
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra
from dexgrasp_env.files import write_atomically

with from_extra():
    import torch


def write_weights(path: Path, model: Cvae, about: dict[str, Any]) -> None:
    """Write weights with the network's sizes and where they come from."""
    from safetensors.torch import save

    tensors = {name: t.detach().cpu().contiguous() for name, t in model.state_dict().items()}
    note = {"schema": SCHEMA, "network": model.settings.as_json()} | about
    write_atomically(path, save(tensors, {"dexgrasp": json.dumps(note, sort_keys=True)}))


def read_weights(path: Path) -> tuple[Cvae, dict[str, Any]]:
    """Return the network of a file of weights, ready to decode, and what the file says of itself.

    Raises:
        InputError: missing, damaged, or of another schema.
    """
    tensors, note = _read(path)
    try:
        if note["schema"] != SCHEMA:
            raise KeyError
        model = Cvae(NetworkSettings(**note["network"]))
        model.load_state_dict(tensors)
    except (KeyError, TypeError, RuntimeError):
        raise wrong_schema(path) from None
    return model.eval(), note


def write_state(
    path: Path, model: torch.nn.Module, optimiser: torch.optim.Optimizer, progress: dict[str, Any]
) -> None:
    """Write all that training needs to go on."""
    from safetensors.torch import save

    tensors = {f"model.{name}": t.detach().cpu().contiguous() for name, t in model.state_dict().items()}
    for k, values in optimiser.state_dict()["state"].items():
        tensors |= {f"adam.{k}.{name}": t.detach().cpu().contiguous() for name, t in values.items()}
    write_atomically(path, save(tensors, {"dexgrasp": json.dumps(progress)}))


def read_state(path: Path, model: torch.nn.Module, optimiser: torch.optim.Optimizer) -> dict[str, Any] | None:
    """Fill model and optimiser from a checkpoint; return its progress, None where there is no checkpoint."""
    if not path.is_file():
        return None
    tensors, progress = _read(path)
    try:
        model.load_state_dict({name[6:]: t for name, t in tensors.items() if name.startswith("model.")})
        states: dict[int, dict[str, torch.Tensor]] = {}
        for name, tensor in tensors.items():
            if name.startswith("adam."):
                _, k, what = name.split(".")
                states.setdefault(int(k), {})[what] = tensor
        optimiser.load_state_dict({"state": states, "param_groups": optimiser.state_dict()["param_groups"]})
    except (RuntimeError, ValueError, KeyError, TypeError):
        raise InputError(
            f"{path} is damaged, or of another network: remove it to train from the start"
        ) from None
    return progress


def _read(path: Path) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    arrays, note = read_arrays(path)
    return {name: torch.from_numpy(array) for name, array in arrays.items()}, note
