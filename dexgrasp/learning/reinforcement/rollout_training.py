"""Training by rounds of rollouts with a learner of Stable-Baselines3.

A round depends on the learner's state and on its number alone, so that an interrupted training goes on to the same
bits: nothing of the environments has to be kept.
"""

from abc import abstractmethod
from dataclasses import asdict
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.learning.imitation.bc_policy import BcPolicy
from dexgrasp.learning.training.checkpoint import Parts
from dexgrasp.learning.training.loop import RunOptions, Task, Training, origin
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


class RolloutTask(Task):
    """Environments and a learner in them, from nothing or from a cloned policy that is corrected.

    Attributes:
        kind: of the policy that is written.
        counted: unit of the learner's steps, in the curve.
        won: name of success in the curve.
    """

    kind: str
    counted: str
    won: str

    def __init__(self, settings: Any, clone: Path | None = None) -> None:
        """Read the cloned policy.

        Args:
            settings: of the training, with `rounds` and `round_steps`, of the learner.
            clone: folder of a cloned policy; None for none.

        Raises:
            InputError: no such policy, or one of another view.
        """
        self.settings = settings
        self.base: Any = read_policy(clone) if clone else None
        self.clone = BcPolicy(*self.base) if self.base else None
        self.env = {"obs_mode": "state", **settings.actions}
        if self.clone and self.clone.env != self.env:
            raise InputError(
                f"reinforcement starts from a clone of {self.env}: this one is of {self.clone.env}, clone another"
            )

    def identity(self) -> Fields:
        """Return the hash of the cloned policy."""
        arrays = self.base and self.base[1]
        return {"clone": arrays and content_hash(*(arrays[name] for name in sorted(arrays)))}

    @abstractmethod
    def environments(self, place: torch.device) -> Any:
        """Make the environments; their `finished` are returns and successes of a round's episodes."""

    @abstractmethod
    def learner(self, envs: Any, place: torch.device) -> BaseAlgorithm:
        """Make the learner, with nothing learned."""

    def before_round(self, model: Any) -> None:
        """Set what follows a schedule."""

    def figures(self) -> Fields:
        """Return what joins the row of a round."""
        return {}

    def policy(self) -> tuple[Fields, Fields]:
        """Return what `policy.json` says, and arrays beside those of the actor and the cloned policy."""
        return {}, {}

    def note(self) -> Fields:
        """Return the task's own state for a checkpoint."""
        return {}

    def restore(self, note: Fields) -> None:
        """Take up what `note` returned."""


class RolloutTraining(Training):
    """The loop of rollouts: rounds of a learner in the environments of a `RolloutTask`, each from a seed of its own."""

    task: RolloutTask
    envs: Any
    model: Any

    def __init__(self, task: RolloutTask, out: Path, options: RunOptions = RunOptions()) -> None:
        """Prepare.

        Args:
            task: what is trained.
            out: folder of the policy, an agent by its path.
            options: where it runs.

        Raises:
            InputError: for a device that is not there.
        """
        super().__init__(task, out, task.settings.rounds, options)

    def build(self) -> None:
        """Make environments and learner; a correction begins with none."""
        self.envs = self.task.environments(self.place)
        self.open.callback(self.envs.close)
        self.model = self.task.learner(self.envs, self.place)
        if self.task.base:
            for tensor in _mean_action(self.model)[-1].parameters():
                torch.nn.init.zeros_(tensor)

    def parts(self) -> Parts:
        """Return networks, optimisers and single tensors of the learner, and its replay buffer."""
        modules, tensors = self.model._get_torch_save_params()
        learned = {name: attrgetter(name)(self.model) for name in (*modules, *tensors)}
        kept = _BUFFER if self._buffer else ()
        return learned | {f"buffer.{name}": torch.from_numpy(getattr(self._buffer, name)) for name in kept}

    def learn(self) -> Fields:
        """Learn from a round's episodes, begun anew from the round's seed."""
        self.task.before_round(self.model)
        words = np.random.SeedSequence([self.settings.seed, 1, self.state.epoch]).generate_state(1)
        self.model.set_random_seed(int(words[0]) >> 1)
        self.model._last_obs = None  # begin anew
        self.model.learn(self.settings.round_steps, reset_num_timesteps=False, log_interval=None)
        row = {self.task.counted: self.model.num_timesteps * getattr(self.settings, "span", 1)}
        if self.envs.finished:
            returns, won = zip(*self.envs.finished, strict=True)
            row |= {"return": np.mean(returns), self.task.won: np.mean(won)}
        return row | self.task.figures()

    def write(self) -> None:
        """Write the policy."""
        own, arrays = self.task.policy()
        arrays |= layer_arrays("actor", _mean_action(self.model))
        about = {
            "kind": self.task.kind, "view": "state", "env": self.task.env, **own,
            "robot": default_cell().robot.stamp,
            "training": origin(self.state, "stable-baselines3", settings=asdict(self.settings)),
        }  # fmt: skip
        if self.task.base:
            base, weights = self.task.base
            about["base"] = base
            arrays |= {f"base.{name}": array for name, array in weights.items()}
        write_policy(self.out, about, arrays)

    def note(self) -> Fields:
        """Return the learner's counters, and the task's state."""
        counts = [getattr(owner, name) for owner, name in self._counters()]
        return {"counters": counts, **self.task.note()}

    def restore(self, note: Fields) -> None:
        """Take up what `note` returned."""
        for (owner, name), count in zip(self._counters(), note["counters"], strict=True):
            setattr(owner, name, count)
        self.task.restore(note)

    def _counters(self) -> list[tuple[Any, str]]:
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
