"""Training by PPO or SAC, from nothing or from a clone whose actions are corrected."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.reinforcement.actor import KIND
from dexgrasp.reinforcement.rounds import ENV, Rounds, forget
from dexgrasp.runs.training import Course, Row
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra
from dexgrasp_env.tasks.constants import MAX_EPISODE_STEPS

with from_extra():
    from stable_baselines3 import PPO, SAC

    from dexgrasp.reinforcement.sb3_vec_env import SB3VecEnv
    from dexgrasp.reinforcement.vec_env import FeatureVecEnv, measure

ALGORITHMS = ("ppo", "sac")
_ROLLOUT = 100  # control steps of every environment between two updates of `ppo`
_BATCHES = 4  # that a rollout is cut into
_MEASURED = 100  # control steps of random actions that features are scaled by, where no clone says how


@dataclass(frozen=True)
class RlSettings:
    """Everything that a training depends on, the clone it starts from apart.

    Attributes:
        algorithm: `ppo` or `sac`, of Stable-Baselines3.
        objects: names, expanded.
        env_id: what is learned.
        steps: control steps, of all environments together.
        num_envs: environments side by side.
        seed: of everything.
        share: of an action that is the residual's, where there is a clone; without one it is 1.
        hidden: width of the two layers of every network.
        rate: of Adam.
        discount: of a reward a step later.
        spread: logarithm of the standard deviation that exploration begins with (`ppo`).
        buffer: steps that `sac` remembers.
        warm_up: steps of random actions before `sac` learns.
        threads: of torch on the CPU; results differ in the last bits with it.
    """

    algorithm: str = "ppo"
    objects: tuple[str, ...] = ("sugar_box",)
    env_id: str = "DexGrasp/Lift-v1"
    steps: int = 1_000_000
    num_envs: int = 16
    seed: int = 0
    share: float = 0.2
    hidden: int = 256
    rate: float = 3e-4
    discount: float = 0.99
    spread: float = -1.0
    buffer: int = 200_000
    warm_up: int = 5_000
    threads: int = 1

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InputError: for an unknown algorithm or a number out of range.
        """
        if self.algorithm not in ALGORITHMS:
            raise InputError(f"algorithm {self.algorithm!r}: valid are {', '.join(ALGORITHMS)}")
        if not 0.0 < self.share <= 1.0:
            raise InputError(f"share is {self.share}: valid are numbers above 0 and up to 1")

    @property
    def round_steps(self) -> int:
        """Steps of a round: an episode of every environment."""
        return self.num_envs * MAX_EPISODE_STEPS

    @property
    def rounds(self) -> int:
        """Rounds that the steps come to, rounded up."""
        return -(-self.steps // self.round_steps)


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
