"""How a policy is trained by reinforcement."""

from dataclasses import dataclass

from dexgrasp_env.errors import InputError
from dexgrasp_env.tasks.constants import MAX_EPISODE_STEPS

ALGORITHMS = ("ppo", "sac")


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
