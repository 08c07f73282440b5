"""Reinforcement in rounds, each from a seed of its own: what the trainings have in common.

A round depends on the learner's state and on its number alone, so that a training that was interrupted goes on to the
same bits: nothing of the environments has to be kept.
"""

from abc import abstractmethod
from dataclasses import asdict
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.learning.imitation.bc_policy import BcPolicy
from dexgrasp.learning.reinforcement.settings import GRASPS
from dexgrasp.learning.training.checkpoint import Parts, damaged
from dexgrasp.learning.training.training import CHECKPOINT, RunOptions, Training
from dexgrasp.runs.policy_folder import read_policy, write_policy
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra
from dexgrasp_env.files import content_hash
from dexgrasp_env.robot.cell import default_cell

with from_extra():
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.base_class import BaseAlgorithm

    from dexgrasp.learning.imitation.bc_network import layer_arrays

_BUFFER = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


class Rounds(Training):
    """A training by a learner of Stable-Baselines3; its folder is an agent by its path.

    Who inherits makes environments, whose `finished` are returns and successes of a round's episodes, and a learner.
    """

    kind: str
    """Of the policy that is written."""
    counted: str
    """What a step of the learner is, in the curve."""
    won: str
    """What success is called in the curve."""
    envs: Any
    model: Any

    def __init__(
        self, out: Path, settings: Any, clone: Path | None = None, course: RunOptions = RunOptions()
    ) -> None:
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
        self.base: Any = read_policy(clone) if clone else None
        self.clone = BcPolicy(*self.base) if self.base else None
        mode = getattr(settings, "control_mode", "joint_delta")
        self.env = {"obs_mode": "state", "control_mode": "ee_delta" if mode == GRASPS else mode}
        if self.clone and self.clone.env != self.env:
            raise InputError(
                f"reinforcement starts from a clone of {self.env}: this one is of {self.clone.env}, clone another"
            )

    def identity(self) -> Fields:
        """Return what the clone is."""
        arrays = self.base and self.base[1]
        return {"clone": arrays and content_hash(*(arrays[name] for name in sorted(arrays)))}

    @abstractmethod
    def environments(self) -> Any:
        """Make the environments."""

    @abstractmethod
    def learner(self) -> BaseAlgorithm:
        """Make the learner in `envs`, with nothing learned."""

    def policy(self) -> tuple[Fields, Fields]:
        """Return what else is said of the policy, and its arrays, but for the actor's and the clone's."""
        return {}, {}

    def build(self) -> None:
        """Make environments and learner; a correction begins with none."""
        self.envs = self.environments()
        self.open.callback(self.envs.close)
        self.model = self.learner()
        if self.base:
            for tensor in _mean_action(self.model)[-1].parameters():
                torch.nn.init.zeros_(tensor)

    def parts(self) -> Parts:
        """Return networks, optimisers and single tensors of the learner, and what it remembers."""
        modules, tensors = self.model._get_torch_save_params()
        learned = {name: attrgetter(name)(self.model) for name in (*modules, *tensors)}
        kept = _BUFFER if self._buffer else ()
        return learned | {f"buffer.{name}": torch.from_numpy(getattr(self._buffer, name)) for name in kept}

    def learn(self) -> Fields:
        """Learn from a round's episodes, begun anew from the round's seed."""
        words = np.random.SeedSequence([self.settings.seed, 1, self.state.epoch]).generate_state(1)
        self.model.set_random_seed(int(words[0]) >> 1)
        self.model._last_obs = None  # begin anew
        self.model.learn(self.settings.round_steps, reset_num_timesteps=False, log_interval=None)
        row = {self.counted: self.model.num_timesteps * getattr(self.settings, "span", 1)}
        if not self.envs.finished:
            return row
        returns, won = zip(*self.envs.finished, strict=True)
        return {**row, "return": np.mean(returns), self.won: np.mean(won)}

    def write(self) -> None:
        """Write the policy."""
        own, arrays = self.policy()
        arrays |= layer_arrays("actor", _mean_action(self.model))
        about = {
            "kind": self.kind, "view": "state", "env": self.env, **own, "robot": default_cell().robot.stamp,
            "training": self.origin("stable-baselines3", settings=asdict(self.settings)),
        }  # fmt: skip
        if self.base:
            about["base"] = self.base[0]
            arrays |= {f"base.{name}": array for name, array in self.base[1].items()}
        write_policy(self.out, about, arrays)

    def note(self) -> Fields:
        """Return the learner's counters."""
        return {"counters": [getattr(owner, name) for owner, name in self.counters()]}

    def begin(self) -> Fields | None:
        """As every training, with the counters."""
        note = super().begin()
        try:
            for (owner, name), count in zip(self.counters(), note["counters"] if note else (), strict=False):
                setattr(owner, name, count)
        except (LookupError, TypeError):
            raise damaged(self.out / CHECKPOINT) from None
        return note

    def counters(self) -> list[tuple[Any, str]]:
        """Return what else a learner goes on from: whose numbers, and their names."""
        own = [(self.model, "num_timesteps"), (self.model, "_n_updates")]
        return own + ([(self._buffer, "pos"), (self._buffer, "full")] if self._buffer else [])

    @property
    def _buffer(self) -> Any:
        return getattr(self.model, "replay_buffer", None)


def _mean_action(model: Any) -> list[torch.nn.Linear]:
    """Return the layers from features to the mean action."""
    if isinstance(model, PPO):
        parts = [*model.policy.mlp_extractor.policy_net, model.policy.action_net]
    else:
        parts = [*model.actor.latent_pi, model.actor.mu]
    return [part for part in parts if isinstance(part, torch.nn.Linear)]
