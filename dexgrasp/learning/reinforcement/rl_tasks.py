"""Tasks of reinforcement learning: a policy by PPO or SAC, and a cloned policy's grip by PPO."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.data.demonstrations.resets import DemoResets
from dexgrasp.learning.imitation.policy import Scaling
from dexgrasp.learning.reinforcement.grip_policy import GripPolicy
from dexgrasp.learning.reinforcement.rl_policy import FARTHEST, ActionSpec, RlPolicy
from dexgrasp.learning.reinforcement.rollout_training import RolloutTask
from dexgrasp.learning.reinforcement.settings import RlSettings
from dexgrasp_env.arrays import Fields
from dexgrasp_env.extras import from_extra
from dexgrasp_env.tasks.control import GRASP_MODES, ONCE_MODES
from dexgrasp_env.tasks.randomisation import ranges

with from_extra():
    import torch
    from stable_baselines3 import PPO, SAC
    from stable_baselines3.common.base_class import BaseAlgorithm

    from dexgrasp.learning.reinforcement.feature_vec_env import FeatureVecEnv, measure
    from dexgrasp.learning.reinforcement.grip_vec_env import GripVecEnv
    from dexgrasp.learning.reinforcement.sb3_vec_env import SB3VecEnv

_FACTOR, _LEAST, _MOST, _AIM = 1.5, 1e-5, 1e-2, 0.01  # of a rate that follows a divergence
_WRITTEN = "residual_scale", "action_repeat", "action_chunk", "once"
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


class PolicyTask(RolloutTask):
    """Training of a policy in rounds of one episode of every environment."""

    kind, counted, won = RlPolicy.kind, "steps", "training_success"

    def __init__(self, settings: RlSettings, clone: Path | None = None) -> None:
        """Read the cloned policy and the demonstrations, where there are any; see `RolloutTask`."""
        super().__init__(settings, clone)
        self._resets = DemoResets(settings.resets) if settings.resets else None
        self._rate = AdaptiveRate(settings.learning_rate, settings.target_kl)

    def environments(self, place: torch.device) -> FeatureVecEnv:
        """Make the environments; features are scaled as the cloned policy's, or by random actions."""
        s = self.settings
        envs = SB3VecEnv(
            s.env_id,
            s.num_envs,
            ("is_success",),
            objects=list(s.objects),
            randomisation=ranges(s.randomise),
            backend=s.backend,
            device="cpu" if (s.backend, place.type) == ("warp", "cpu") else None,
            **self.env,
            **({"max_episode_steps": s.episode_steps} if s.episode_steps else {}),
        )
        if self._resets:
            self._resets.attach(envs.envs)
        scale = s.residual_scale or (0.2 if self.clone else 1.0)
        grasps, once = self.env["control_mode"] in GRASP_MODES, s.limit <= s.span
        spec = ActionSpec(Scaling(0.0, 1.0), self.clone, scale, s.action_repeat, grasps, s.action_chunk, once)
        if self.clone:
            scaling = self.clone.scaling
        else:
            envs.seed(s.seed)
            held = _MEASURED if self.env["control_mode"] in ONCE_MODES else self.env.get("hold", 1)
            outputs = max(_MEASURED // (spec.span * held), 10 // s.action_chunk, 1)
            scaling = measure(envs, spec, outputs, np.random.default_rng([s.seed, 0]))
        self.spec = spec._replace(scaling=scaling)
        farthest = FARTHEST if grasps and s.algorithm == "ppo" else 1.0
        limited = s.episode_steps is not None
        return FeatureVecEnv(envs, self.spec, s.reward_scale, s.gamma, limited, farthest)

    def learner(self, envs: FeatureVecEnv, place: torch.device) -> BaseAlgorithm:
        """Make the learner."""
        s = self.settings
        common: Fields = {
            "policy": "MlpPolicy",
            "env": envs,
            "gamma": s.gamma,
            "seed": s.seed,
            "device": place,
        }
        net_arch = {"net_arch": list(s.net_arch)}
        if s.algorithm == "sac":
            return SAC(
                learning_rate=s.learning_rate, buffer_size=s.buffer_size, learning_starts=s.learning_starts,
                train_freq=1, gradient_steps=s.gradient_steps, policy_kwargs=net_arch, **common,
            )  # fmt: skip
        _, n_steps = s.rollouts
        self._rate.model = PPO(
            learning_rate=self._rate if s.adaptive else s.learning_rate, n_steps=n_steps, n_epochs=s.n_epochs,
            batch_size=max(n_steps * s.num_envs // _BATCHES, 2),
            target_kl=None if s.adaptive else s.target_kl, use_sde=s.noise == "rollout",
            policy_kwargs=net_arch | {"log_std_init": self._log_std(s.log_std_init)}, **common,
        )  # fmt: skip
        return self._rate.model

    def before_round(self, model: Any) -> None:
        """Begin the round's resets, and set the exploration that is due: its logarithm falls in a straight line."""
        s = self.settings
        if self._resets:
            self._resets.go_on(**self._resets.progress)
        if s.log_std_final is not None:
            done = min(model.num_timesteps * s.span / s.steps, 1.0)
            with torch.no_grad():
                model.policy.log_std.fill_(
                    self._log_std((1.0 - done) * s.log_std_init + done * s.log_std_final)
                )

    def _log_std(self, wanted: float) -> float:
        """Return the learner's parameter for an exploration of this logarithm."""
        # Correlated noise is a sum over the outputs of the last hidden layer.
        s = self.settings
        return wanted - (0.5 * math.log(s.net_arch[-1]) if s.noise == "rollout" else 0.0)

    def figures(self) -> Fields:
        """Return the rate where it changes, and the front of resets along demonstrations."""
        rate = {"rate": self._rate.now} if self.settings.adaptive else {}
        return rate | ({"front": self._resets.front} if self._resets else {})

    def note(self) -> Fields:
        """Return the rate and the progress of resets."""
        return {"rate": self._rate.now, "resets": self._resets and self._resets.progress}

    def restore(self, note: Fields) -> None:
        """Take up rate and resets."""
        self._rate.now = note["rate"]
        if self._resets:
            self._resets.go_on(**note["resets"])

    def policy(self) -> tuple[Fields, Fields]:
        """Return what an `RlPolicy` reads."""
        is_sac, stated = (
            self.settings.algorithm == "sac",
            {name: getattr(self.spec, name) for name in _WRITTEN},
        )
        about = stated | {"activation": "relu" if is_sac else "tanh", "squashed": is_sac}
        return about, self.spec.scaling._asdict()


class GripTask(RolloutTask):
    """Training of corrections of a cloned policy's grip."""

    kind, counted, won = GripPolicy.kind, "episodes", "training_held"

    def environments(self, place: torch.device) -> GripVecEnv:
        """Make the environments."""
        s = self.settings
        assert self.clone, "a grip is a cloned policy's"
        return GripVecEnv(
            s.env_id, s.num_envs, self.clone, s.group_size, objects=list(s.objects),
            max_episode_steps=s.episode_steps, randomisation={"friction": s.friction, "mass": s.mass}, **self.env,
        )  # fmt: skip

    def learner(self, envs: GripVecEnv, place: torch.device) -> PPO:
        """Make the learner."""
        s = self.settings
        return PPO(
            "MlpPolicy", envs, n_steps=s.round_episodes, n_epochs=s.n_epochs, target_kl=s.target_kl,
            batch_size=max(2, s.round_steps // 2), learning_rate=s.learning_rate,
            policy_kwargs={"net_arch": list(s.net_arch), "log_std_init": s.log_std_init}, seed=s.seed,
            device=place,
        )  # fmt: skip
