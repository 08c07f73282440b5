"""Settings of reinforcement learning."""

import math
from dataclasses import dataclass
from typing import Annotated

from gymnasium import registry, spec

from dexgrasp_env.arrays import Fields
from dexgrasp_env.objects.load import Objects
from dexgrasp_env.tasks.constants import MAX_EPISODE_STEPS
from dexgrasp_env.tasks.control import CONTROL_MODES, ONCE_MODES
from dexgrasp_env.tasks.observations import FLAT
from dexgrasp_env.tasks.randomisation import Draws, ranges
from dexgrasp_env.tasks.settings import BACKENDS
from dexgrasp_env.valid import Count, Natural, Positive, check_fields, number, one_of

_LIFTS = one_of(sorted(name for name in registry if name.startswith("DexGrasp/Lift")))


@dataclass(frozen=True)
class RlSettings:
    """Settings that a training depends on.

    Attributes:
        objects: objects, sets or mesh files to learn on.
        algorithm: `ppo` or `sac`, of Stable-Baselines3.
        env_id: what is learned, from its features.
        control_mode: of the environments (default: as registered); grasp: set-points of the palm about the object and
            of the hand's closing; grasp_once: a whole grasp.
        hold: control steps that an action stands for (default: as registered); limits count actions.
        max_episode_steps: actions of an episode (default: as registered).
        backend: their physics: mujoco; warp: mujoco_warp on the device (extra gpu).
        randomise: what every episode draws: friction, mass, size, gain, latency, joint_noise (default: as registered).
        resets: demonstrations that episodes begin along, backwards from success.
        steps: actions, of all environments together.
        num_envs: environments side by side.
        seed: of everything.
        net_arch: widths of the layers of every network.
        learning_rate: of Adam.
        gamma: discount of a reward an action later.
        log_std_init: logarithm of the standard deviation of exploration at first (`ppo`).
        log_std_final: the same at the last step (`ppo`; default: it is learned).
        n_steps: actions of every environment between two updates, at most (`ppo`).
        n_epochs: over a rollout in an update (`ppo`).
        target_kl: KL at which an update stops (`ppo`; default: never).
        buffer_size: actions that `sac` remembers.
        learning_starts: random actions before `sac` learns.
        gradient_steps: of `sac` after an action of every environment.
        threads: of torch on the CPU; the last bits depend on it.
    """

    objects: Annotated[Objects, "OBJECT"]
    algorithm: Annotated[str, one_of(("ppo", "sac"))] = "ppo"
    env_id: Annotated[str, _LIFTS] = "DexGrasp/Lift-v2"
    control_mode: Annotated[str | None, one_of(CONTROL_MODES)] = None
    hold: Count | None = None
    max_episode_steps: Count | None = None
    backend: Annotated[str, one_of(BACKENDS)] = "mujoco"
    randomise: Draws = ()
    resets: Annotated[str | None, "DIR"] = None
    steps: Count = 1_000_000
    num_envs: Count = 16
    seed: Natural = 0
    net_arch: tuple[Count, ...] = (256, 256)
    learning_rate: Positive = 3e-4
    gamma: float = 0.99
    log_std_init: Annotated[float, number(ge=-5, le=2)] = -1.0
    log_std_final: Annotated[float | None, number(ge=-5, le=2)] = None
    n_steps: Annotated[int, number(ge=2, whole=True)] = 100
    n_epochs: Count = 5
    target_kl: Positive | None = None
    buffer_size: Count = 200_000
    learning_starts: Count = 5_000
    gradient_steps: Count = 1
    threads: Count = 1

    def __post_init__(self) -> None:
        """Check the fields."""
        check_fields(self)

    @property
    def env_arguments(self) -> Fields:
        """Keywords of `gym.make_vec`: features, and settings that differ from the registered ones."""
        given = {
            "control_mode": self.control_mode,
            "hold": self.hold,
            "max_episode_steps": self.max_episode_steps,
            "randomisation": ranges(self.randomise) or None,
        }
        own = {"obs_mode": FLAT, "objects": list(self.objects), "backend": self.backend}
        return own | {key: value for key, value in given.items() if value is not None}

    @property
    def length(self) -> int:
        """Largest number of actions of an episode."""
        registered = spec(self.env_id)
        if (self.control_mode or registered.kwargs.get("control_mode")) in ONCE_MODES:
            return 1
        return self.max_episode_steps or registered.max_episode_steps or MAX_EPISODE_STEPS

    @property
    def rollouts(self) -> tuple[int, int]:
        """Number of rollouts in a round, and of actions of every environment in each; a round is an episode or more."""
        number = -(-self.length // self.n_steps)
        return number, self.n_steps if number == 1 else -(-self.length // number)

    @property
    def round_steps(self) -> int:
        """Number of actions in a round, of all environments together."""
        return self.num_envs * math.prod(self.rollouts)

    @property
    def rounds(self) -> int:
        """Number of rounds for `steps` actions, rounded up."""
        return -(-self.steps // self.round_steps)
