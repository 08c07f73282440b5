"""How a policy is trained by reinforcement."""

from dataclasses import dataclass
from typing import Annotated

from dexgrasp_env.objects.load import Objects
from dexgrasp_env.tasks.constants import MAX_EPISODE_STEPS
from dexgrasp_env.valid import Count, Natural, Positive, number, one_of


@dataclass(frozen=True)
class RlSettings:
    """Everything that a training depends on, the clone it starts from apart.

    Attributes:
        objects: objects, sets or mesh files to learn on.
        algorithm: `ppo` or `sac`, of Stable-Baselines3.
        env_id: what is learned.
        steps: control steps, of all environments together.
        num_envs: environments side by side.
        seed: of everything.
        share: of an action that is the network's, where there is a clone to begin with; without one it is 1.
        hidden: width of the two layers of every network.
        rate: of Adam.
        discount: of a reward a step later.
        spread: logarithm of the standard deviation that exploration begins with (`ppo`).
        buffer: steps that `sac` remembers.
        warm_up: steps of random actions before `sac` learns.
        threads: of torch on the CPU; results differ in the last bits with it.
    """

    objects: Annotated[Objects, "OBJECT"]
    algorithm: Annotated[str, one_of(("ppo", "sac"))] = "ppo"
    env_id: str = "DexGrasp/Lift-v1"
    steps: Count = 1_000_000
    num_envs: Count = 16
    seed: Natural = 0
    share: Annotated[float, number(gt=0, le=1)] = 0.2
    hidden: Count = 256
    rate: Positive = 3e-4
    discount: float = 0.99
    spread: Annotated[float, number(ge=-5, le=2)] = -1.0
    buffer: Count = 200_000
    warm_up: Count = 5_000
    threads: Count = 1

    @property
    def round_steps(self) -> int:
        """Steps of a round: an episode of every environment."""
        return self.num_envs * MAX_EPISODE_STEPS

    @property
    def rounds(self) -> int:
        """Rounds that the steps come to, rounded up."""
        return -(-self.steps // self.round_steps)
