"""Teaching a clone a firmer grip by reinforcement, in rounds with seeds of their own: resumable to the same bits."""

from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from agents.imitation.policy_folder import read_policy, write_policy
from agents.imitation.trials import Trials, due_success
from agents.learning.device import torch_device
from agents.learning.epochs import Progress, progress_of, run_epochs
from agents.learning.folder import claim_training, occupy
from agents.reinforcement.checkpoint import load_learner, save_learner
from agents.reinforcement.grip import KIND
from agents.reinforcement.grip_settings import GripSettings
from agents.reinforcement.training import CHECKPOINT, RUN, actor_arrays, checked_clone
from agents.versions import package_versions
from dexgrasp_env.extras import from_extra
from dexgrasp_env.files import content_hash

with from_extra():
    import torch
    from stable_baselines3 import PPO

    from agents.reinforcement.grip_env import GripVecEnv

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
    run = {
        "schema": 1, "clone": content_hash(*(base[1][name] for name in sorted(base[1]))),
        "settings": settings.as_json(), "trials": None if trials is None else asdict(trials),
    }  # fmt: skip
    with occupy(out):
        claim_training(out, RUN, run)
        training = GripTraining(out, settings, base, place)
        try:
            return training.run(trials, progress, stop_after)
        finally:
            training.envs.close()


class GripTraining:
    """A training in its folder."""

    def __init__(self, out: Path, settings: GripSettings, base: Any, place: torch.device) -> None:
        self.out, self.settings, self.base = out, settings, base
        clone = checked_clone(*base)
        self.envs = GripVecEnv(
            settings.env_id, settings.num_envs, clone, (base[1]["mean"], base[1]["scale"]), settings.alike,
            objects=list(settings.objects), max_episode_steps=settings.episode_steps,
            randomisation={"friction": settings.friction, "mass": settings.mass}, **clone.env,
        )  # fmt: skip
        self.model = _learner(settings, self.envs, place)
        self.state = Progress(epochs=settings.rounds)

    def run(
        self, trials: Trials | None, progress: Callable[[Progress], None] | None, stop_after: int | None
    ) -> Progress:
        """Go on to the last round; see `train_grip`."""
        path = self.out / CHECKPOINT
        found = load_learner(path, self.model)
        state = self.state = self.state if found is None else progress_of(found, path)
        judge = partial(due_success, self.out, trials, state)
        run_epochs(state, self.out, self._round, self._keep, progress, stop_after, judge)
        return state

    def _keep(self) -> None:
        save_learner(self.out / CHECKPOINT, self.model, asdict(self.state))

    def _round(self) -> dict[str, Any]:
        words = np.random.SeedSequence([self.settings.seed, 1, self.state.epoch]).generate_state(1)
        self.model.set_random_seed(int(words[0]) >> 1)
        self.model._last_obs = None  # begin anew
        episodes = self.settings.num_envs * self.settings.round_episodes
        self.model.learn(episodes, reset_num_timesteps=False, log_interval=None)
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
