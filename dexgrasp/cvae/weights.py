"""Weights of the CVAE as safetensors: arrays and text, nothing that runs when it is read."""

from pathlib import Path
from typing import Any

from dexgrasp.cvae.autoencoder import Cvae
from dexgrasp.planning.decoder import SCHEMA, NetworkSettings, wrong_schema
from dexgrasp.runs.arrays import read_arrays
from dexgrasp.runs.checkpoint import write_tensors
from dexgrasp_env.extras import from_extra

with from_extra():
    import torch


def write_weights(path: Path, model: Cvae, about: dict[str, Any]) -> None:
    """Write weights with the network's sizes and where they come from."""
    write_tensors(path, model.state_dict(), {"schema": SCHEMA, "network": model.settings.as_json()} | about)


def read_weights(path: Path) -> tuple[Cvae, dict[str, Any]]:
    """Return the network of a file of weights, ready to decode, and what the file says of itself.

    Raises:
        InputError: missing, damaged, or of another schema.
    """
    arrays, note = read_arrays(path)
    try:
        if note["schema"] != SCHEMA:
            raise KeyError
        model = Cvae(NetworkSettings(**note["network"]))
        model.load_state_dict({name: torch.from_numpy(array) for name, array in arrays.items()})
    except (KeyError, TypeError, RuntimeError):
        raise wrong_schema(path) from None
    return model.eval(), note
