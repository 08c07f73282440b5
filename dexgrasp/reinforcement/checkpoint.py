"""A learner of Stable-Baselines3 on disk without pickle: parameters as safetensors, the buffer of `sac` as npz."""

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.runs.arrays import read_arrays
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra
from dexgrasp_env.files import write_atomically

with from_extra():
    import torch

_BUFFER = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def save_learner(path: Path, model: Any, progress: dict[str, Any]) -> None:
    """Write parameters, the states of optimisers, counters and progress; and the buffer, where there is one."""
    from safetensors.torch import save

    tensors: dict[str, torch.Tensor] = {}
    for name, module in _modules(model).items():
        tensors |= {f"{name}/{key}": value for key, value in module.state_dict().items()}
    for name, optimiser in _optimisers(model).items():
        for k, values in optimiser.state_dict()["state"].items():
            tensors |= {f"{name}/{k}/{key}": value for key, value in values.items()}
    if getattr(model, "log_ent_coef", None) is not None:
        tensors["log_ent_coef"] = model.log_ent_coef
    counters = {"num_timesteps": model.num_timesteps, "n_updates": model._n_updates}
    if getattr(model, "replay_buffer", None) is not None:
        _save_buffer(path.with_suffix(".buffer.npz"), model.replay_buffer, model.num_timesteps)
    note = {"progress": progress, "counters": counters}
    kept = {name: tensor.detach().cpu().contiguous().clone() for name, tensor in tensors.items()}
    write_atomically(path, save(kept, {"dexgrasp": json.dumps(note)}))


def load_learner(path: Path, model: Any) -> dict[str, Any] | None:
    """Fill a learner from a checkpoint; return the progress, None where there is no checkpoint.

    Raises:
        InputError: if it is damaged, or of another learner.
    """
    if not path.is_file():
        return None
    arrays, note = read_arrays(path)
    try:
        tensors = {name: torch.from_numpy(array) for name, array in arrays.items()}
        for name, module in _modules(model).items():
            module.load_state_dict(_below(tensors, f"{name}/"))
        for name, optimiser in _optimisers(model).items():
            _fill(optimiser, _below(tensors, f"{name}/"))
        if "log_ent_coef" in tensors:
            model.log_ent_coef.data.copy_(tensors["log_ent_coef"])
        model.num_timesteps = int(note["counters"]["num_timesteps"])
        model._n_updates = int(note["counters"]["n_updates"])
        if getattr(model, "replay_buffer", None) is not None:
            _load_buffer(path.with_suffix(".buffer.npz"), model.replay_buffer, model.num_timesteps)
        return dict(note["progress"])
    except (RuntimeError, ValueError, KeyError, TypeError, OSError, zipfile.BadZipFile):
        raise InputError(
            f"{path} is damaged, or of another learner: remove it to train from the start"
        ) from None


def _modules(model: Any) -> dict[str, torch.nn.Module]:
    return {"policy": model.policy}


def _optimisers(model: Any) -> dict[str, torch.optim.Optimizer]:
    """The optimisers of `ppo`, or of `sac`."""
    policy = model.policy
    if getattr(model, "ent_coef_optimizer", None) is None:
        return {"optimiser": policy.optimizer}
    return {
        "actor_optimiser": model.actor.optimizer,
        "critic_optimiser": model.critic.optimizer,
        "entropy_optimiser": model.ent_coef_optimizer,
    }


def _below(tensors: dict[str, torch.Tensor], prefix: str) -> dict[str, torch.Tensor]:
    return {name.removeprefix(prefix): tensor for name, tensor in tensors.items() if name.startswith(prefix)}


def _fill(optimiser: torch.optim.Optimizer, tensors: dict[str, torch.Tensor]) -> None:
    states: dict[int, dict[str, torch.Tensor]] = {}
    for name, tensor in tensors.items():
        k, _, key = name.partition("/")
        states.setdefault(int(k), {})[key] = tensor
    optimiser.load_state_dict({"state": states, "param_groups": optimiser.state_dict()["param_groups"]})


def _save_buffer(path: Path, buffer: Any, steps: int) -> None:
    count = buffer.buffer_size if buffer.full else buffer.pos
    arrays = {name: getattr(buffer, name)[:count] for name in _BUFFER}
    arrays["where"] = np.array([buffer.pos, buffer.full, steps], dtype=np.int64)
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, **arrays)
    write_atomically(path, content.getvalue())


def _load_buffer(path: Path, buffer: Any, steps: int) -> None:
    """Fill a buffer; one that was written after another number of steps (a kill in between) is refused."""
    with np.load(path, allow_pickle=False) as file:
        position, full, written = (int(value) for value in file["where"])
        if written != steps:
            raise ValueError("the buffer is of another moment")
        for name in _BUFFER:
            rows = file[name]
            getattr(buffer, name)[: len(rows)] = rows
    buffer.pos, buffer.full = position, bool(full)
