"""Reinforcement in rounds, each from a seed of its own: what the trainings have in common.

A round depends on the learner's state and on its number alone, so that a training that was interrupted goes on to the
same bits: nothing of the environments has to be kept.
"""

import io
from abc import abstractmethod
from dataclasses import asdict
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.imitation.clone import Clone
from dexgrasp.runs.checkpoint import Parts, damaged
from dexgrasp.runs.policy_folder import read_policy, write_policy
from dexgrasp.runs.training import CHECKPOINT, Course, Row, Training
from dexgrasp.runs.versions import package_versions
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra
from dexgrasp_env.files import content_hash, read_npz, write_atomically

with from_extra():
    import torch
    from stable_baselines3 import PPO

ENV = {"obs_mode": "state", "control_mode": "joint_delta"}
"""What clones that are corrected see and command."""
_BUFFER = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
_PACKAGES = ("dexgrasp", "numpy", "torch", "stable-baselines3")


class Rounds(Training):
    """A training by a learner of Stable-Baselines3; its folder is an agent by its path.

    Who inherits makes `envs`, whose `finished` are returns and successes of a round's episodes, and `model`.
    """

    kind: str
    """Of the policy that is written."""
    counted: str
    """What a step of the learner is, in the curve."""
    won: str
    """What success is called in the curve."""
    envs: Any
    model: Any

    def __init__(self, out: Path, settings: Any, clone: Path | None, course: Course) -> None:
        """Read the clone.

        Args:
            out: folder of the policy.
            settings: of the training, with `rounds` and `round_steps`, of the learner.
            clone: folder of a cloned policy that is corrected; None for none.
            course: where it runs.

        Raises:
            InputError: no such clone, one of another view, no such device.
        """
        super().__init__(out, settings, settings.rounds, course)
        self.base: Any = None if clone is None else read_policy(clone)
        self.clone = None if self.base is None else Clone(*self.base)
        if self.clone and (self.clone.view != "state" or self.clone.env != ENV):
            raise InputError(
                f"reinforcement starts from a clone of {ENV}: this one is of {self.clone.env}, clone another"
            )

    def identity(self) -> Row:
        """Return what the clone is."""
        arrays = self.base and self.base[1]
        return {"clone": arrays and content_hash(*(arrays[name] for name in sorted(arrays)))}

    @abstractmethod
    def policy(self) -> tuple[Row, dict[str, Any]]:
        """Return what is said of the policy, and its arrays, but for the actor's and the clone's."""

    def parts(self) -> Parts:
        """Return networks, optimisers and single tensors of the learner."""
        modules, tensors = self.model._get_torch_save_params()
        return {name: attrgetter(name)(self.model) for name in (*modules, *tensors)}

    def learn(self) -> Row:
        """Learn from a round's episodes, begun anew from the round's seed."""
        words = np.random.SeedSequence([self.settings.seed, 1, self.state.epoch]).generate_state(1)
        self.model.set_random_seed(int(words[0]) >> 1)
        self.model._last_obs = None  # begin anew
        self.model.learn(self.settings.round_steps, reset_num_timesteps=False, log_interval=None)
        row = {self.counted: self.model.num_timesteps}
        if not self.envs.finished:
            return row
        returns, won = zip(*self.envs.finished, strict=True)
        return {**row, "return": float(np.mean(returns)), self.won: float(np.mean(won))}

    def write(self) -> None:
        """Write the policy."""
        own, arrays = self.policy()
        arrays |= actor_arrays(self.model)
        about = {
            "kind": self.kind, "view": "state", "env": ENV, **own,
            "training": {
                "settings": asdict(self.settings), **self.state.curve[-1], "versions": package_versions(_PACKAGES),
            },
        }  # fmt: skip
        if self.base is not None:
            about["base"] = self.base[0]
            arrays |= {f"base.{name}": array for name, array in self.base[1].items()}
        write_policy(self.out, about, arrays)

    def note(self) -> Row:
        """Return the learner's counters; what it remembers goes into a file of its own."""
        model = self.model
        if buffer := getattr(model, "replay_buffer", None):
            count = buffer.buffer_size if buffer.full else buffer.pos
            arrays = {name: getattr(buffer, name)[:count] for name in _BUFFER}
            arrays["where"] = np.array([buffer.pos, buffer.full, model.num_timesteps], dtype=np.int64)
            content = io.BytesIO()
            np.savez(content, allow_pickle=False, **arrays)
            write_atomically(self._buffer_path, content.getvalue())
        return {"counters": {"num_timesteps": model.num_timesteps, "n_updates": model._n_updates}}

    def begin(self) -> Row | None:
        """As every training, from counters and buffer; a buffer of another moment (a kill in between) is refused."""
        note = super().begin()
        try:
            if note is not None:
                self._fill(**note["counters"])
        except (OSError, ValueError, LookupError, TypeError):
            raise damaged(self.out / CHECKPOINT) from None
        return note

    def _fill(self, num_timesteps: int, n_updates: int) -> None:
        self.model.num_timesteps, self.model._n_updates = num_timesteps, n_updates
        if buffer := getattr(self.model, "replay_buffer", None):
            arrays = read_npz(self._buffer_path)
            position, full, written = (int(value) for value in arrays["where"])
            if written != num_timesteps:
                raise ValueError("the buffer is of another moment")
            for name in _BUFFER:
                getattr(buffer, name)[: len(arrays[name])] = arrays[name]
            buffer.pos, buffer.full = position, bool(full)

    @property
    def _buffer_path(self) -> Path:
        return self.out / "checkpoint.buffer.npz"


def forget(layer: torch.nn.Linear) -> None:
    """Have a layer say nothing at first: a correction begins with none."""
    torch.nn.init.zeros_(layer.weight)
    torch.nn.init.zeros_(layer.bias)


def actor_arrays(model: Any) -> dict[str, Any]:
    """Return the layers from features to the mean action."""
    if isinstance(model, PPO):
        parts = [*model.policy.mlp_extractor.policy_net, model.policy.action_net]
    else:
        parts = [*model.actor.latent_pi, model.actor.mu]
    linear = [part for part in parts if isinstance(part, torch.nn.Linear)]
    return {
        f"actor.{k}.{name}": getattr(layer, name).detach().cpu().numpy()
        for k, layer in enumerate(linear)
        for name in ("weight", "bias")
    }
