"""Checkpoints of trainings as safetensors: arrays and JSON, no code."""

from collections.abc import Mapping
from pathlib import Path

from dexgrasp.runs.weights import below, read_arrays, write_arrays
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra

with from_extra():
    import torch
    from torch.optim import Optimizer

Trainable = torch.nn.Module | Optimizer | torch.Tensor
Trainables = Mapping[str, Trainable]
"""Trainable state by name."""


def write_state(path: Path, parts: Trainables, note: Fields) -> None:
    """Write trainable state, and a note, which is JSON."""
    write_tensors(
        path, {f"{name}/{key}": t for name, part in parts.items() for key, t in _tensors(part).items()}, note
    )


def write_tensors(path: Path, tensors: Mapping[str, torch.Tensor], note: Fields) -> None:
    """Write tensors, and a note, which is JSON."""
    write_arrays(path, {name: tensor.detach().cpu().numpy() for name, tensor in tensors.items()}, note)


def read_state(path: Path, parts: Trainables) -> Fields | None:
    """Restore trainable state from a file of `write_state`; return its note, None without a file.

    Raises:
        InputError: if it is damaged, or of other parts.
    """
    if not path.is_file():
        return None
    arrays, note = read_arrays(path)
    try:
        for name, part in parts.items():
            _fill(part, {key: torch.from_numpy(array) for key, array in below(arrays, f"{name}/").items()})
        return note
    except (RuntimeError, ValueError, KeyError, TypeError):
        raise damaged(path) from None


def damaged(path: Path) -> InputError:
    """Return the error for a checkpoint that a training cannot resume from."""
    return InputError(f"{path} is damaged, or of another training: remove it to train from the start")


def _tensors(part: Trainable) -> dict[str, torch.Tensor]:
    if isinstance(part, torch.Tensor):
        return {"": part}
    if isinstance(part, Optimizer):
        return {
            f"{k}/{key}": tensor
            for k, state in part.state_dict()["state"].items()
            for key, tensor in state.items()
        }
    return part.state_dict()


def _fill(part: Trainable, tensors: dict[str, torch.Tensor]) -> None:
    if isinstance(part, torch.Tensor):
        part.data.copy_(tensors[""])
    elif isinstance(part, Optimizer):
        states = dict[int, dict[str, torch.Tensor]]()
        for name, tensor in tensors.items():
            k, _, key = name.partition("/")
            states.setdefault(int(k), {})[key] = tensor
        part.load_state_dict({"state": states, "param_groups": part.state_dict()["param_groups"]})
    else:
        part.load_state_dict(tensors)
