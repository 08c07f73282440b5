"""`dexgrasp train bc | grip | ppo | sac`: policies cloned from demonstrations, and by reinforcement."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from dexgrasp.cli.command import Answer, Folder, Options
from dexgrasp.cli.figures import shown
from dexgrasp.cli.training import TrainingCommand, run_training
from dexgrasp.imitation.settings import BcSettings
from dexgrasp.reinforcement.grip_settings import GripSettings
from dexgrasp.reinforcement.settings import RlSettings
from dexgrasp_env.extras import require_extra
from dexgrasp_env.valid import Count, Natural, Positive, one_of

if TYPE_CHECKING:
    from dexgrasp.imitation.trials import Trials
    from dexgrasp.runs.training import Progress, Training

_GRIP = ("objects", "episodes", "friction", "mass", "num_envs", "rate", "threads")
_SAC = (
    "objects", "env_id", "control_mode", "randomise", "resets", "share", "steps", "num_envs", "rate", "threads",
)  # fmt: skip


class _Tried(Options):
    """Trials while it learns (seeds of their own: 0 to 99 are for tuning).

    Attributes:
        try_on: objects or sets (default: no trials).
        trials: on each.
        every: epochs, of reinforcement rounds, between trials.
    """

    try_on: Annotated[tuple[str, ...], "OBJECT"] = ()
    trials: Count = 1
    every: Count = 20


class _Policy(TrainingCommand, _Tried):
    """The policy.

    Attributes:
        seeds: one or several, each a policy of its own in a folder seed-S.
    """

    seeds: Annotated[tuple[Natural, ...], "--seed", "S"] = (0,)

    def train_each(self, unit: str, settings: Any, make: "Callable[..., Training]", **course: Any) -> Answer:
        """Train a policy for each seed, return the figures of its last epoch.

        Args:
            unit: of the bar.
            settings: of the training, the seed apart.
            make: given a folder, settings and a course, makes the training.
            **course: what the course has beside device and trials.
        """
        from dexgrasp.runs.training import Course

        where, results, seeds = (
            Course(self.device, tester=self._trials(), **course),
            [],
            dict.fromkeys(self.seeds),
        )
        for seed in seeds:
            out = self.out if len(seeds) == 1 else self.out / f"seed-{seed}"
            training = partial(make, out=out, settings=replace(settings, seed=seed), course=where)
            name = f"{type(self).__name__.lower()}, seed {seed}"
            state = run_training(training, out, unit, name, _last_figures).state
            results.append({"policy": str(out), **state.curve[-1], "seconds": state.seconds})
        lines = (
            "; ".join(f"{key.replace('_', ' ')} {shown(value)}" for key, value in row.items())
            for row in results
        )
        return Answer({"policies": results}, "\n".join(lines))

    def _trials(self) -> "Trials | None":
        from dexgrasp.imitation.trials import Trials
        from dexgrasp_env.objects.load import resolve_targets

        return (
            Trials(tuple(resolve_targets(self.try_on)), self.trials, every=self.every)
            if self.try_on
            else None
        )


def _last_figures(state: "Progress") -> dict[str, Any]:
    return {key: value for key, value in state.curve[-1].items() if key != "epoch" and value is not None}


class Bc(_Policy):
    """Clone a policy from demonstrations.

    examples:
      dexgrasp demos generate --objects varied-0..99 --episodes 20 --noise 0.03 --out runs/demos --workers 2
      dexgrasp train bc --data runs/demos --out runs/bc --minutes 10
      dexgrasp train bc --data runs/demos --view cloud --out runs/bc_cloud --epochs 30 --seed 0 1 2
      dexgrasp train bc --data runs/demos --out runs/bc --epochs 20 --try-on seen --trials 3 --every 5
      dexgrasp evaluate --agents runs/bc bilevel --objects all20

    A policy sees the whole state, or joints and one look at a cloud, and predicts the set-points of the next 8 control
    steps. --out then holds policy.json and policy.safetensors: an agent by its path, wherever agents are named. A run
    that was interrupted goes on when the same command is given again, on a CPU to the same bits.

    Attributes:
        data: of `dexgrasp demos generate`.
        view: what the policy sees (default: what the demonstrations do).
        minutes: as many epochs as fit, by measured speed.
        every: epochs between trials.
    """

    data: tuple[Folder, ...]
    view: Annotated[str | None, one_of(("state", "cloud"))] = None
    settings: Annotated[BcSettings, ("epochs", "threads", "hidden", "chunk", "execute")] = BcSettings()
    minutes: Annotated[Positive | None, "M", {"instead_of": "settings.epochs"}] = None
    every: Count = 5

    def run(self) -> Answer:
        """Train a policy for each seed, return losses and successes."""
        require_extra("learning", "training")
        from dexgrasp.imitation.cloning import Cloning

        settings = replace(self.settings, view=self.view or _view(self.data[0]))
        return self.train_each("epoch", settings, partial(Cloning, self.data), minutes=self.minutes)


def _view(folder: Path) -> str:
    from dexgrasp.demos.generate import read_about
    from dexgrasp.imitation.features import view_of

    return view_of(str(read_about(folder)["settings"].get("obs_mode")))


class Grip(_Policy):
    """Correct the grip of a cloned policy by reinforcement.

    examples:
      dexgrasp train grip --objects varied-0..59 --from runs/bc --out runs/grip
      dexgrasp train grip --objects varied-0..59 --from runs/bc --friction 0.3 0.5 --mass 1 1.5 --out runs/grip
      dexgrasp evaluate --agents runs/grip runs/bc --objects all20 --protocol robust

    PPO of Stable-Baselines3, one decision an episode: from the first look the network shifts and tilts the palm by up
    to 3 cm and 0.2 rad and bends fingers and thumb, and a policy of `train bc` from the state acts with that. It begins
    with no correction. Episodes are slippery and heavy by default, as a grip that holds there bears pushes as well. A
    run that was interrupted goes on when the same command is given again, on a CPU to the same bits.

    Attributes:
        clone: a policy of `train bc`.
        every: rounds between trials.
    """

    settings: Annotated[GripSettings, _GRIP]
    clone: Annotated[Folder, "--from"]
    every: Count = 10

    def run(self) -> Answer:
        """Train a policy for each seed, return returns and successes."""
        require_extra("learning", "training")
        from dexgrasp.reinforcement.grip_training import GripTraining

        return self.train_each("round", self.settings, partial(GripTraining, clone=self.clone))


class _Rl(_Policy):
    """How it begins.

    Attributes:
        settings: of the training.
        clone: a policy of `train bc` to begin with.
    """

    settings: RlSettings
    clone: Annotated[Folder | None, "--from"] = None

    def run(self) -> Answer:
        """Train a policy for each seed, return returns and successes."""
        require_extra("learning", "training")
        from dexgrasp.reinforcement.policy_training import PolicyTraining

        settings = replace(self.settings, algorithm=type(self).__name__.lower())
        return self.train_each("round", settings, partial(PolicyTraining, clone=self.clone))


class Ppo(_Rl):
    """Train a policy with PPO.

    examples:
      dexgrasp train ppo --objects sugar_box --steps 2000000 --out runs/ppo
      dexgrasp train ppo --objects varied-0..29 --from runs/bc --steps 500000 --out runs/ppo_bc --try-on seen
      dexgrasp train ppo --objects sugar_box --control-mode ee_delta --resets runs/demos --out runs/ppo_demos
      dexgrasp train ppo --objects seen --env-id DexGrasp/LiftPushed-v2 --randomise mass=0.8:1.2 --out runs/ppo_pushed
      dexgrasp evaluate --agents runs/ppo_bc runs/bc --objects all20 --protocol lift pushed slippery

    Stable-Baselines3's algorithm on the native vector environment, dense reward. With --from, a cloned policy acts and
    a share of the network's action is added to its own: what it can do already is the start. A run that was interrupted
    goes on when the same command is given again; rounds (one episode of every environment) have seeds of their own, so
    that on a CPU it goes on to the same bits.
    """

    settings: Annotated[RlSettings, (*_SAC, "spread")]


class Sac(_Rl):
    """Train a policy with SAC.

    examples:
      dexgrasp train sac --objects seen --from runs/bc --share 0.1 --out runs/sac_bc --seed 0 1 2

    All else is as of `dexgrasp train ppo`, whose help says more.
    """

    settings: Annotated[RlSettings, _SAC]
