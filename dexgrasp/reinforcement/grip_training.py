"""Teaching a clone a firmer grip by reinforcement."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dexgrasp.reinforcement.grip import KIND
from dexgrasp.reinforcement.rounds import Rounds, forget
from dexgrasp.runs.training import Course, Row
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra

with from_extra():
    from stable_baselines3 import PPO

    from dexgrasp.reinforcement.grip_env import GripVecEnv


@dataclass(frozen=True)
class GripSettings:
    """Everything that a training depends on, the clone apart.

    Attributes:
        objects: names, expanded.
        friction: coefficients that episodes draw from.
        mass: factors on the objects' masses that episodes draw from.
        env_id: what is learned.
        episode_steps: control steps of an episode: enough to lift and to hold for about 2 s.
        episodes: of all environments together.
        num_envs: environments side by side.
        round_episodes: of every environment between two updates.
        alike: environments that begin alike; a return counts by how far it is above theirs.
        seed: of everything.
        hidden: width of the two layers of actor and critic.
        rate: of Adam.
        spread: logarithm of the standard deviation that exploration begins with.
        passes: over a round's episodes in an update.
        divergence: KL at which an update stops.
        threads: of torch on the CPU; results differ in the last bits with it.
    """

    objects: tuple[str, ...] = ("varied-0",)
    friction: tuple[float, float] = (0.3, 0.5)
    mass: tuple[float, float] = (1.0, 1.5)
    env_id: str = "DexGrasp/Lift-v1"
    episode_steps: int = 110
    episodes: int = 3000
    num_envs: int = 16
    round_episodes: int = 6
    alike: int = 4
    seed: int = 0
    hidden: int = 32
    rate: float = 2e-3
    spread: float = -1.0
    passes: int = 10
    divergence: float = 0.08
    threads: int = 1

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InputError: if environments do not come out in groups.
        """
        if self.num_envs % self.alike:
            raise InputError(f"num_envs is {self.num_envs}: valid are multiples of {self.alike}")

    @property
    def round_steps(self) -> int:
        """Decisions of a round: one an episode."""
        return self.num_envs * self.round_episodes

    @property
    def rounds(self) -> int:
        """Rounds that the episodes come to, rounded up."""
        return -(-self.episodes // self.round_steps)


class GripTraining(Rounds):
    """Training of corrections of a clone's grip."""

    kind, counted, won = KIND, "episodes", "training_held"

    def __init__(self, out: Path, settings: GripSettings, clone: Path, course: Course = Course()) -> None:
        """As `Rounds`."""
        super().__init__(out, settings, clone, course)

    def build(self) -> None:
        """Make environments, and a learner that begins with no correction."""
        s = self.settings
        assert self.clone and self.base, "a grip is a clone's"
        self.envs = GripVecEnv(
            s.env_id, s.num_envs, self.clone, (self.base[1]["mean"], self.base[1]["scale"]), s.alike,
            objects=list(s.objects), max_episode_steps=s.episode_steps,
            randomisation={"friction": s.friction, "mass": s.mass}, **self.clone.env,
        )  # fmt: skip
        self.open.callback(self.envs.close)
        self.model = PPO(
            "MlpPolicy", self.envs, n_steps=s.round_episodes, n_epochs=s.passes, target_kl=s.divergence,
            batch_size=max(2, s.round_steps // 2), learning_rate=s.rate,
            policy_kwargs={"net_arch": [s.hidden, s.hidden], "log_std_init": s.spread}, seed=s.seed,
            device=self.place,
        )  # fmt: skip
        forget(self.model.policy.action_net)

    def policy(self) -> tuple[Row, dict[str, Any]]:
        """Return what a `Grip` reads."""
        return {}, {}
