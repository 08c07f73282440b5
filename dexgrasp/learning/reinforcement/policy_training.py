"""Training by PPO or SAC, from nothing or from a clone, whose actions are corrected, or once an episode its grip."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.data.demonstrations.resets import DemoResets
from dexgrasp.learning.imitation.policy import Scaling
from dexgrasp.learning.reinforcement.grasp_space import FARTHEST
from dexgrasp.learning.reinforcement.grip_policy import GripPolicy
from dexgrasp.learning.reinforcement.rl_policy import ActionSpec, RlPolicy
from dexgrasp.learning.reinforcement.rounds import Rounds
from dexgrasp.learning.reinforcement.settings import GRASPS, RlSettings
from dexgrasp.learning.training.training import RunOptions
from dexgrasp_env.arrays import Fields
from dexgrasp_env.extras import from_extra
from dexgrasp_env.tasks.randomisation import ranges

with from_extra():
    import torch
    from stable_baselines3 import PPO, SAC
    from stable_baselines3.common.base_class import BaseAlgorithm

    from dexgrasp.learning.reinforcement.feature_vec_env import FeatureVecEnv, measure
    from dexgrasp.learning.reinforcement.grip_vec_env import GripVecEnv
    from dexgrasp.learning.reinforcement.sb3_vec_env import SB3VecEnv

_FACTOR, _LEAST, _MOST, _AIM = 1.5, 1e-5, 1e-2, 0.01  # of a rate that follows a divergence
_WRITTEN = "residual_scale", "action_repeat", "action_chunk", "once", "grasps"
_BATCHES = 4  # that a rollout is cut into
_MEASURED = 100  # control steps of random actions that features are scaled by, where no clone says how


class AdaptiveRate:
    """A schedule of Stable-Baselines3, a rate of Adam that follows how far updates change a policy, as RSL-RL has it.

    It goes up after updates below half of a KL divergence, down after those past twice. The first update
    after `learn` has begun keeps the rate: nothing but `now` has to be kept between rounds.
    """

    model: PPO | None = None
    """That learns with it, once it is made."""

    def __init__(self, first: float, aim: float | None) -> None:
        """Begin with a rate; `aim` is the divergence that an update should come to."""
        self.now, self._aim = first, aim or _AIM

    def __call__(self, left: float) -> float:
        """Return the rate of the next update; `left`, the share of the training that is left, plays no part."""
        # It is asked more than once an update: what an update came to counts once.
        known = self.model.logger.name_to_value.pop("train/approx_kl", None) if self.model else None
        if known and known > 2.0 * self._aim:
            self.now = max(self.now / _FACTOR, _LEAST)
        elif known and 0.0 < known < 0.5 * self._aim:
            self.now = min(self.now * _FACTOR, _MOST)
        return self.now


class PolicyTraining(Rounds):
    """Training of a policy in rounds of one episode of every environment."""

    kind, counted, won = RlPolicy.kind, "steps", "training_success"

    def __init__(
        self, out: Path, settings: RlSettings, clone: Path | None = None, course: RunOptions = RunOptions()
    ) -> None:
        """As `Rounds`; without a clone it begins from nothing."""
        super().__init__(out, settings, clone, course)
        self._resets = DemoResets(settings.resets) if settings.resets else None
        self._rate = AdaptiveRate(settings.learning_rate, settings.target_kl)

    def environments(self) -> FeatureVecEnv:
        """Make the environments; features are scaled as the clone's, or by random actions."""
        s = self.settings
        envs = SB3VecEnv(
            s.env_id, s.num_envs, ("is_success",), objects=list(s.objects), randomisation=ranges(s.randomise),
            backend=s.backend, device="cpu" if self.place.type == "cpu" else None, **self.env,
            **({"max_episode_steps": s.episode_steps} if s.episode_steps else {}),
        )  # fmt: skip
        if self._resets:
            self._resets.attach(envs.envs)
        share = s.residual_scale or (0.2 if self.clone else 1.0)
        grasps = s.control_mode == GRASPS
        spec = ActionSpec(
            Scaling(0.0, 1.0), self.clone, share, s.action_repeat, grasps, s.action_chunk, s.limit <= s.span
        )
        if self.clone:
            scaling = self.clone.scaling
        else:
            envs.seed(s.seed)
            looks = max(_MEASURED // spec.span, 10 // s.action_chunk, 1)
            scaling = measure(envs, spec, looks, np.random.default_rng([s.seed, 0]))
        self._spec = spec._replace(scaling=scaling)
        farthest = FARTHEST if grasps and s.algorithm == "ppo" else 1.0
        limited = s.episode_steps is not None
        return FeatureVecEnv(envs, self._spec, s.reward_scale, s.gamma, limited, farthest)

    def learner(self) -> BaseAlgorithm:
        """Make the learner."""
        s = self.settings
        common: Fields = {
            "learning_rate": s.learning_rate, "gamma": s.gamma, "seed": s.seed, "device": self.place,
        }  # fmt: skip
        width = {"net_arch": list(s.net_arch)}
        if s.algorithm == "sac":
            return SAC(
                "MlpPolicy",
                self.envs,
                buffer_size=s.buffer_size,
                learning_starts=s.learning_starts,
                train_freq=1,
                gradient_steps=s.gradient_steps,
                policy_kwargs=width,
                **common,
            )
        _, rollout = s.rollouts
        if s.adaptive:
            common["learning_rate"] = self._rate
        self._rate.model = PPO(
            "MlpPolicy", self.envs, n_steps=rollout, n_epochs=s.n_epochs,
            batch_size=max(rollout * s.num_envs // _BATCHES, 2),
            target_kl=None if s.adaptive else s.target_kl, use_sde=s.noise == "rollout",
            policy_kwargs=width | {"log_std_init": self._log_std(s.log_std_init)}, **common,
        )  # fmt: skip
        return self._rate.model

    def learn(self) -> Fields:
        """As every round, with the rate where it changes, and from where along demonstrations episodes begin."""
        if self._resets:
            self._resets.go_on(**self._resets.progress)
        if self.settings.log_std_final is not None:
            self._settle()
        row = super().learn()
        rate = {"rate": self._rate.now} if self.settings.adaptive else {}
        return row | rate | ({"front": self._resets.front} if self._resets else {})

    def _settle(self) -> None:
        """Explore as far as is due by now: evenly less in the logarithm, whatever the learner has made of it."""
        s = self.settings
        share = min(self.model.num_timesteps * s.span / s.steps, 1.0)
        with torch.no_grad():
            self.model.policy.log_std.fill_(
                self._log_std((1.0 - share) * s.log_std_init + share * s.log_std_final)
            )

    def _log_std(self, spread: float) -> float:
        """Return what the learner has for an exploration of logarithm `spread`."""
        # Correlated noise is a sum over the outputs of the last hidden layer.
        s = self.settings
        return spread - (0.5 * math.log(s.net_arch[-1]) if s.noise == "rollout" else 0.0)

    def note(self) -> Fields:
        """As every round's, with where resets are."""
        return super().note() | {"resets": self._resets and self._resets.progress}

    def begin(self) -> Fields | None:
        """As every training, with where resets were."""
        note = super().begin()
        if note and self._resets:
            self._resets.go_on(**note["resets"])
        return note

    def counters(self) -> list[tuple[Any, str]]:
        """As every learner's, with the rate."""
        return [*super().counters(), (self._rate, "now")]

    def policy(self) -> tuple[Fields, Fields]:
        """Return what an `RlPolicy` reads."""
        is_sac = self.settings.algorithm == "sac"
        about = {
            **{name: getattr(self._spec, name) for name in _WRITTEN},
            "activation": "relu" if is_sac else "tanh",
            "squashed": is_sac,
        }
        return about, self._spec.scaling._asdict()


class GripTraining(Rounds):
    """Training of corrections of a clone's grip."""

    kind, counted, won = GripPolicy.kind, "episodes", "training_held"

    def environments(self) -> GripVecEnv:
        """Make the environments."""
        s = self.settings
        assert self.clone, "a grip is a clone's"
        return GripVecEnv(
            s.env_id, s.num_envs, self.clone, s.group_size, objects=list(s.objects),
            max_episode_steps=s.episode_steps, randomisation={"friction": s.friction, "mass": s.mass}, **self.env,
        )  # fmt: skip

    def learner(self) -> PPO:
        """Make the learner."""
        s = self.settings
        return PPO(
            "MlpPolicy", self.envs, n_steps=s.round_episodes, n_epochs=s.n_epochs, target_kl=s.target_kl,
            batch_size=max(2, s.round_steps // 2), learning_rate=s.learning_rate,
            policy_kwargs={"net_arch": list(s.net_arch), "log_std_init": s.log_std_init}, seed=s.seed,
            device=self.place,
        )  # fmt: skip
