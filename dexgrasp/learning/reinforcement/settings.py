"""Settings of reinforcement learning: of a policy, and of a cloned policy's grip."""

import math
from dataclasses import dataclass
from typing import Annotated

from gymnasium import registry, spec

from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.load import Objects
from dexgrasp_env.tasks.constants import MAX_EPISODE_STEPS
from dexgrasp_env.tasks.control import CONTROL_MODES, ONCE_MODES
from dexgrasp_env.tasks.randomisation import Draws
from dexgrasp_env.tasks.settings import BACKENDS
from dexgrasp_env.valid import Count, Natural, Positive, number, one_of, pair

_LIFTS = one_of(sorted(name for name in registry if name.startswith("DexGrasp/Lift")))
Range = Annotated[tuple[float, float], pair(number(gt=0)), "LEAST", "MOST"]
NEWEST_LIFT = max(
    (each for each in registry.values() if each.namespace == "DexGrasp" and each.name == "Lift"),
    key=lambda each: each.version or 0,
).id


@dataclass(frozen=True)
class RlSettings:
    """Everything that a training depends on, the clone it starts from apart.

    Attributes:
        objects: objects, sets or mesh files to learn on.
        algorithm: `ppo` or `sac`, of Stable-Baselines3.
        env_id: what is learned.
        control_mode: of the environments (default: what the environment is registered with); grasp: set-points of the
            palm about the object and of the hand's closing; grasp_once: a whole grasp, and a look an episode.
        action_repeat: control steps that an action of the network stands for.
        action_chunk: actions, one after the other, that it gives at a look.
        episode_steps: control steps after which an episode is over, what would come then unvalued (default: those of
            the environment, which cut it short).
        backend: their physics: mujoco; warp: mujoco_warp on the device (extra gpu). Trials are MuJoCo's.
        randomise: what every episode draws: friction, mass, size, gain, latency, joint_noise.
        resets: demonstrations that episodes begin along, backwards from success.
        steps: control steps, of all environments together.
        num_envs: environments side by side.
        seed: of everything.
        residual_scale: of the network's action that is carried out (default: 0.2 on a clone's action, 1 alone).
        net_arch: widths of the layers of every network.
        learning_rate: of Adam; of its first updates with `adaptive`.
        gamma: of a reward a look later, of those between two looks in proportion.
        reward_scale: factor on rewards, which the learner's values grow with.
        log_std_init: logarithm of the standard deviation that exploration begins with (`ppo`).
        log_std_final: what that logarithm is brought to by the last step (`ppo`; default: it is learned).
        noise: of exploration (`ppo`): of every step, or, a function of what is seen, of a whole rollout.
        n_steps: looks of every environment between two updates, at most: a round is cut into equal parts (`ppo`).
        n_epochs: over a rollout in an update (`ppo`).
        target_kl: KL at which an update stops (`ppo`; default: never).
        adaptive: the rate follows the divergence (default: 0.01), in place of a stop: up after an update below half of
            it, down after one past twice (`ppo`).
        buffer_size: actions that `sac` remembers.
        learning_starts: random actions, of all environments together, before `sac` learns.
        gradient_steps: of `sac` after an action of every environment.
        threads: of torch on the CPU; results differ in the last bits with it.
    """

    objects: Annotated[Objects, "OBJECT"]
    algorithm: Annotated[str, one_of(("ppo", "sac"))] = "ppo"
    env_id: Annotated[str, _LIFTS] = NEWEST_LIFT
    control_mode: Annotated[str | None, one_of(CONTROL_MODES)] = None
    action_repeat: Count = 1
    action_chunk: Count = 1
    episode_steps: Count | None = None
    backend: Annotated[str, one_of(BACKENDS)] = "mujoco"
    randomise: Draws = ()
    resets: Annotated[str | None, "DIR"] = None
    steps: Count = 1_000_000
    num_envs: Count = 16
    seed: Natural = 0
    residual_scale: Annotated[float | None, number(gt=0, le=1)] = None
    net_arch: tuple[Count, ...] = (256, 256)
    learning_rate: Positive = 3e-4
    gamma: float = 0.99
    reward_scale: Positive = 1.0
    log_std_init: Annotated[float, number(ge=-5, le=2)] = -1.0
    log_std_final: Annotated[float | None, number(ge=-5, le=2)] = None
    noise: Annotated[str, one_of(("step", "rollout"))] = "step"
    n_steps: Count = 100
    n_epochs: Count = 5
    target_kl: Positive | None = None
    adaptive: bool = False
    buffer_size: Count = 200_000
    learning_starts: Count = 5_000
    gradient_steps: Count = 1
    threads: Count = 1

    @property
    def actions(self) -> Fields:
        """Keywords of `gym.make` that say what actions are."""
        own = spec(self.env_id).kwargs
        mode = {"control_mode": self.control_mode or own.get("control_mode", "joint_delta")}
        return mode | ({"hold": own["hold"]} if "hold" in own and not self.control_mode else {})

    @property
    def span(self) -> int:
        """Control steps between two looks of the network."""
        return self.action_repeat * self.action_chunk

    @property
    def limit(self) -> int:
        """Steps of the environments in an episode: control steps, where an action stands for one."""
        if self.actions["control_mode"] in ONCE_MODES:
            return 1
        return self.episode_steps or spec(self.env_id).max_episode_steps or MAX_EPISODE_STEPS

    @property
    def length(self) -> int:
        """The network's looks in an episode, the last of which it may end early."""
        return -(-self.limit // self.span)

    @property
    def rollouts(self) -> tuple[int, int]:
        """Number of rollouts in a round of `ppo`, and looks of every environment in each."""
        least = -(-2 // self.num_envs)  # two answers are the least that an update can tell good from bad by
        number = -(-self.length // max(self.n_steps, least))
        return number, max(-(-self.length // number), least)

    @property
    def round_steps(self) -> int:
        """The network's looks in a round: an episode of every environment, with `ppo` whole rollouts."""
        return self.num_envs * (math.prod(self.rollouts) if self.algorithm == "ppo" else self.length)

    @property
    def rounds(self) -> int:
        """Rounds that the steps come to, rounded up."""
        return -(-self.steps // (self.round_steps * self.span))


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
        group_size: environments that begin alike; a return counts by how far it is above theirs.
        seed: of everything.
        net_arch: widths of the layers of actor and critic.
        learning_rate: of Adam.
        log_std_init: logarithm of the standard deviation that exploration begins with.
        n_epochs: over a round's episodes in an update.
        target_kl: KL at which an update stops.
        threads: of torch on the CPU; results differ in the last bits with it.
    """

    objects: Annotated[Objects, "OBJECT"]
    friction: Range = (0.3, 0.5)
    mass: Range = (1.0, 1.5)
    env_id: str = NEWEST_LIFT
    episode_steps: Count = 110
    episodes: Count = 3000
    num_envs: Count = 16
    round_episodes: Count = 6
    group_size: Count = 4
    seed: Natural = 0
    net_arch: tuple[Count, ...] = (32, 32)
    learning_rate: Positive = 2e-3
    log_std_init: float = -1.0
    n_epochs: Count = 10
    target_kl: Positive = 0.08
    threads: Count = 1

    def __post_init__(self) -> None:
        """Check what no field alone can be wrong in.

        Raises:
            InputError: if environments do not come out in groups, or in groups of one, none of which is above its own.
        """
        if self.group_size < 2:
            raise InputError(
                f"group_size is {self.group_size}: valid is 2 or more, as a reward is a difference"
            )
        if self.num_envs % self.group_size:
            raise InputError(f"num_envs is {self.num_envs}: valid are multiples of {self.group_size}")

    @property
    def actions(self) -> Fields:
        """Keywords of `gym.make` that say what actions are: those of the clone."""
        return {"control_mode": "joint_delta"}

    @property
    def round_steps(self) -> int:
        """Decisions of a round: one an episode."""
        return self.num_envs * self.round_episodes

    @property
    def rounds(self) -> int:
        """Rounds that the episodes come to, rounded up."""
        return -(-self.episodes // self.round_steps)
