"""Teaching a clone a firmer grip by reinforcement, in rounds with seeds of their own: resumable to the same bits."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.imitation.trials import Trials
from dexgrasp.reinforcement.grip import KIND
from dexgrasp.reinforcement.grip_settings import GripSettings
from dexgrasp.reinforcement.rounds import Rounds, run_rounds
from dexgrasp.reinforcement.training import actor_arrays, checked_clone
from dexgrasp.runs.device import torch_device
from dexgrasp.runs.epochs import Progress
from dexgrasp.runs.policy_folder import read_policy, write_policy
from dexgrasp.runs.versions import package_versions
from dexgrasp_env.extras import from_extra

with from_extra():
    import torch
    from stable_baselines3 import PPO

    from dexgrasp.reinforcement.grip_env import GripVecEnv

_PACKAGES = ("dexgrasp", "numpy", "torch", "stable-baselines3")


def train_grip(
    out: Path, settings: GripSettings, *, clone: Path, device: str = "cpu", trials: Trials | None = None,
    progress: Callable[[Progress], None] | None = None, stop_after: int | None = None,
) -> Progress:  # fmt: skip
    """Train corrections of a clone's grip, or go on with what `out` holds; `out` is an agent by its path.

    Args:
        out: folder of policy, checkpoint and curves.
        settings: of the training; `out` of other settings is refused.
        clone: folder of the cloned policy.
        device: cpu, cuda or auto.
        trials: what the policy is tried on as it learns; None for no trials.
        progress: called after every round.
        stop_after: rounds of this call, for tests of resuming.

    Raises:
        InputError: no such clone, one of another view, other settings or another process in `out`, no such device.
    """
    place = torch_device(device)
    torch.set_num_threads(settings.threads)
    base = read_policy(clone)
    checked_clone(*base)  # refused before `out` is claimed
    return run_rounds(partial(GripTraining, place=place), out, settings, base, trials, progress, stop_after)


class GripTraining(Rounds):
    """A training in its folder."""

    def __init__(self, out: Path, settings: GripSettings, base: Any, place: torch.device) -> None:
        super().__init__(out, settings, base)
        clone = checked_clone(*base)
        self.envs = GripVecEnv(
            settings.env_id, settings.num_envs, clone, (base[1]["mean"], base[1]["scale"]), settings.alike,
            objects=list(settings.objects), max_episode_steps=settings.episode_steps,
            randomisation={"friction": settings.friction, "mass": settings.mass}, **clone.env,
        )  # fmt: skip
        self.model = _learner(settings, self.envs, place)

    def _round(self) -> dict[str, Any]:
        self._learn(self.settings.num_envs * self.settings.round_episodes)
        returns, held = zip(*self.envs.finished, strict=True)
        row = {
            "epoch": self.state.epoch + 1, "episodes": self.model.num_timesteps,
            "return": float(np.mean(returns)), "training_held": float(np.mean(held)),
        }  # fmt: skip
        self._write_policy(row)
        return row

    def _write_policy(self, row: dict[str, Any]) -> None:
        arrays = actor_arrays(self.model) | {f"base.{name}": array for name, array in self.base[1].items()}
        about = {
            "kind": KIND, "view": "state", "env": self.base[0]["env"], "base": self.base[0],
            "training": {"settings": self.settings.as_json(), **row, "versions": package_versions(_PACKAGES)},
        }  # fmt: skip
        write_policy(self.out, about, arrays)


def _learner(settings: GripSettings, envs: GripVecEnv, place: torch.device) -> Any:
    """Return a learner that begins with no correction."""
    model: Any = PPO(
        "MlpPolicy", envs, n_steps=settings.round_episodes, n_epochs=settings.passes, target_kl=settings.divergence,
        batch_size=max(2, settings.num_envs * settings.round_episodes // 2), learning_rate=settings.rate,
        policy_kwargs={"net_arch": [settings.hidden, settings.hidden], "log_std_init": settings.spread},
        seed=settings.seed, device=place,
    )  # fmt: skip
    torch.nn.init.zeros_(model.policy.action_net.weight)
    torch.nn.init.zeros_(model.policy.action_net.bias)
    return model
