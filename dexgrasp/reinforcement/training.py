"""Training by reinforcement, in rounds: one episode of every environment, from seeds of its own.

A round depends on the learner's state and on its number alone, so that a training that was interrupted goes on to the
same bits: nothing of the environments has to be kept.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.imitation.clone import Clone
from dexgrasp.imitation.trials import Trials
from dexgrasp.reinforcement.actor import KIND
from dexgrasp.reinforcement.rounds import Rounds, run_rounds
from dexgrasp.reinforcement.settings import RlSettings
from dexgrasp.runs.device import torch_device
from dexgrasp.runs.epochs import Progress
from dexgrasp.runs.policy_folder import read_policy, write_policy
from dexgrasp.runs.versions import package_versions
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra

with from_extra():
    import torch
    from stable_baselines3 import PPO, SAC

    from dexgrasp.reinforcement.sb3_vec_env import SB3VecEnv
    from dexgrasp.reinforcement.vec_env import FeatureVecEnv, measure

_ROLLOUT = 100  # control steps of every environment between two updates of `ppo`
_BATCHES = 4  # that a rollout is cut into
_MEASURED = 100  # control steps of random actions that features are scaled by, where no clone says how
_ENV = {"obs_mode": "state", "control_mode": "joint_delta"}
_PACKAGES = ("dexgrasp", "numpy", "torch", "stable-baselines3")


def train_rl(
    out: Path, settings: RlSettings, *, clone: Path | None = None, device: str = "cpu", trials: Trials | None = None,
    progress: Callable[[Progress], None] | None = None, stop_after: int | None = None,
) -> Progress:  # fmt: skip
    """Train a policy, or go on with what `out` holds; `out` is an agent by its path.

    Args:
        out: folder of policy, checkpoint and curves.
        settings: of the training; `out` of other settings is refused.
        clone: folder of a cloned policy whose actions are corrected; None to begin from nothing.
        device: cpu, cuda or auto.
        trials: what the policy is tried on as it learns; None for no trials.
        progress: called after every round.
        stop_after: rounds of this call, for tests of resuming.

    Raises:
        InputError: no such clone, one of another view, other settings or another process in `out`, no such device.
    """
    place = torch_device(device)
    torch.set_num_threads(settings.threads)
    base = None if clone is None else read_policy(clone)
    if base is not None:
        checked_clone(*base)  # refused before `out` is claimed
    return run_rounds(partial(_Training, place=place), out, settings, base, trials, progress, stop_after)


class _Training(Rounds):
    """A training in its folder."""

    def __init__(self, out: Path, settings: RlSettings, base: Any, place: torch.device) -> None:
        super().__init__(out, settings, base)
        envs = SB3VecEnv(settings.env_id, settings.num_envs, objects=list(settings.objects), **_ENV)
        clone = None if base is None else checked_clone(*base)
        if base is None:
            envs.seed(settings.seed)
            rng = np.random.default_rng([settings.seed, 0])
            self.mean, self.scale = measure(envs, _MEASURED, rng)
        else:
            self.mean, self.scale = base[1]["mean"], base[1]["scale"]
        self.share = settings.share if base is not None else 1.0
        self.envs = FeatureVecEnv(envs, self.mean, self.scale, clone, self.share)
        self.model = _learner(settings, self.envs, place, base is not None)

    def _round(self) -> dict[str, Any]:
        self._learn(self.settings.round_steps)
        finished = self.envs.finished
        row: dict[str, Any] = {"epoch": self.state.epoch + 1, "steps": self.model.num_timesteps}
        if finished:
            returns, successes = zip(*finished, strict=True)
            row |= {"return": float(np.mean(returns)), "training_success": float(np.mean(successes))}
        self._write_policy(row)
        return row

    def _write_policy(self, row: dict[str, Any]) -> None:
        arrays = {"mean": self.mean, "scale": self.scale, **actor_arrays(self.model)}
        about: dict[str, Any] = {
            "kind": KIND, "view": "state", "env": _ENV, "share": self.share,
            "activation": "relu" if self.settings.algorithm == "sac" else "tanh",
            "squashed": self.settings.algorithm == "sac",
            "training": {"settings": self.settings.as_json(), **row, "versions": package_versions(_PACKAGES)},
        }  # fmt: skip
        if self.base is not None:
            about["base"] = self.base[0]
            arrays |= {f"base.{name}": array for name, array in self.base[1].items()}
        write_policy(self.out, about, arrays)


def checked_clone(about: dict[str, Any], arrays: Any) -> Clone:
    """Return the clone that reinforcement starts from.

    Raises:
        InputError: if it is of another view.
    """
    clone = Clone(about, arrays)
    if clone.view != "state" or clone.env != _ENV:
        raise InputError(
            f"reinforcement starts from a clone of {_ENV}: this one is of {clone.env}, clone another"
        )
    return clone


def _learner(settings: RlSettings, envs: FeatureVecEnv, place: torch.device, corrects: bool) -> Any:
    """Return a learner of Stable-Baselines3; one that corrects begins with no correction."""
    width = [settings.hidden, settings.hidden]
    common: dict[str, Any] = {
        "learning_rate": settings.rate,
        "gamma": settings.discount,
        "seed": settings.seed,
        "device": place,
    }
    if settings.algorithm == "ppo":
        model: Any = PPO(
            "MlpPolicy", envs, n_steps=_ROLLOUT, batch_size=_ROLLOUT * settings.num_envs // _BATCHES, n_epochs=5,
            policy_kwargs={"net_arch": width, "log_std_init": settings.spread}, **common,
        )  # fmt: skip
        last = model.policy.action_net
    else:
        model = SAC(
            "MlpPolicy", envs, buffer_size=settings.buffer, learning_starts=settings.warm_up, train_freq=1,
            policy_kwargs={"net_arch": width}, **common,
        )  # fmt: skip
        last = model.actor.mu
    if corrects:
        torch.nn.init.zeros_(last.weight)
        torch.nn.init.zeros_(last.bias)
    return model


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
