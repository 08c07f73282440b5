"""Training by PPO or SAC, from nothing or from a clone whose actions are corrected."""

from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.reinforcement.actor import KIND
from dexgrasp.reinforcement.rounds import ENV, Rounds, forget
from dexgrasp.reinforcement.settings import RlSettings
from dexgrasp.runs.training import Course, Row
from dexgrasp_env.extras import from_extra

with from_extra():
    from stable_baselines3 import PPO, SAC

    from dexgrasp.reinforcement.feature_vec_env import FeatureVecEnv, measure
    from dexgrasp.reinforcement.sb3_vec_env import SB3VecEnv

_ROLLOUT = 100  # control steps of every environment between two updates of `ppo`
_BATCHES = 4  # that a rollout is cut into
_MEASURED = 100  # control steps of random actions that features are scaled by, where no clone says how


class PolicyTraining(Rounds):
    """Training of a policy in rounds of one episode of every environment."""

    kind, counted, won = KIND, "steps", "training_success"

    def __init__(
        self, out: Path, settings: RlSettings, clone: Path | None = None, course: Course = Course()
    ) -> None:
        """As `Rounds`; without a clone it begins from nothing."""
        super().__init__(out, settings, clone, course)
        self._share = settings.share if clone else 1.0

    def build(self) -> None:
        """Make environments and learner; features are scaled as the clone's, or by random actions."""
        settings = self.settings
        envs = SB3VecEnv(settings.env_id, settings.num_envs, objects=list(settings.objects), **ENV)
        if self.base is None:
            envs.seed(settings.seed)
            self._scaling = measure(envs, _MEASURED, np.random.default_rng([settings.seed, 0]))
        else:
            self._scaling = self.base[1]["mean"], self.base[1]["scale"]
        self.envs = FeatureVecEnv(envs, self._scaling, self.clone, self._share)
        self.open.callback(self.envs.close)
        self.model = self._learner()
        if self.base is not None:
            forget(self.model.policy.action_net if settings.algorithm == "ppo" else self.model.actor.mu)

    def _learner(self) -> Any:
        s = self.settings
        common: dict[str, Any] = {
            "learning_rate": s.rate, "gamma": s.discount, "seed": s.seed, "device": self.place,
        }  # fmt: skip
        width = {"net_arch": [s.hidden, s.hidden]}
        if s.algorithm == "sac":
            return SAC(
                "MlpPolicy", self.envs, buffer_size=s.buffer, learning_starts=s.warm_up, train_freq=1,
                policy_kwargs=width, **common,
            )  # fmt: skip
        return PPO(
            "MlpPolicy", self.envs, n_steps=_ROLLOUT, batch_size=_ROLLOUT * s.num_envs // _BATCHES, n_epochs=5,
            policy_kwargs=width | {"log_std_init": s.spread}, **common,
        )  # fmt: skip

    def policy(self) -> tuple[Row, dict[str, Any]]:
        """Return what an `Actor` reads."""
        is_sac = self.settings.algorithm == "sac"
        about = {"share": self._share, "activation": "relu" if is_sac else "tanh", "squashed": is_sac}
        return about, dict(zip(("mean", "scale"), self._scaling, strict=True))
