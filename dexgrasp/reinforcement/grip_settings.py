"""How a clone is taught a firmer grip."""

from dataclasses import dataclass
from typing import Annotated

from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.load import Objects
from dexgrasp_env.valid import Count, Natural, Positive, number, pair

Range = Annotated[tuple[float, float], pair(number(gt=0)), "LEAST", "MOST"]


@dataclass(frozen=True)
class GripSettings:
    """Everything that a training depends on, the clone apart.

    Attributes:
        objects: objects, sets or mesh files to learn on.
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

    objects: Annotated[Objects, "OBJECT"]
    friction: Range = (0.3, 0.5)
    mass: Range = (1.0, 1.5)
    env_id: str = "DexGrasp/Lift-v1"
    episode_steps: Count = 110
    episodes: Count = 3000
    num_envs: Count = 16
    round_episodes: Count = 6
    alike: Count = 4
    seed: Natural = 0
    hidden: Count = 32
    rate: Positive = 2e-3
    spread: float = -1.0
    passes: Count = 10
    divergence: Positive = 0.08
    threads: Count = 1

    def __post_init__(self) -> None:
        """Check what no field alone can be wrong in.

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
