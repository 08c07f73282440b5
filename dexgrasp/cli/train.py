"""Train networks: the learned half of the paper, policies cloned from demonstrations or reinforced.

examples:
  dexgrasp train cvae --data runs/ycb6 --out runs/cvae --minutes 25
  dexgrasp train bc --data runs/demos --out runs/bc --minutes 10
  dexgrasp train ppo --objects seen --env-id DexGrasp/LiftStaged-v0 --resets runs/demos --out runs/ppo
  dexgrasp evaluate --agents runs/bc runs/ppo hardcoded --objects seen

A run that was interrupted goes on when the same command is given again, on a CPU to the same bits. The folder of a
policy is an agent by its path (JSON and safetensors); with several seeds it has a folder seed-S for each.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from dexgrasp.cli.command import Answer, Command, Folder, Options
from dexgrasp.cli.output import resumable, shown
from dexgrasp.learning.cvae.settings import TrainingSettings
from dexgrasp.learning.imitation.settings import BcSettings
from dexgrasp.learning.reinforcement.settings import RlSettings
from dexgrasp.runs.progress import progress_bar
from dexgrasp_env.arrays import Fields
from dexgrasp_env.extras import from_extra
from dexgrasp_env.valid import Count, Natural, Positive, one_of

if TYPE_CHECKING:
    from dexgrasp.learning.training.loop import RunOptions, Training, TrainingState

    Make = Callable[[Path, RunOptions], Training]

_CVAE = ("epochs", "seed", "threads", "latent", "kl_weight", "wrench_layer", "held_out_object")
_BC = ("epochs", "threads", "hidden", "chunk", "execute")
_OF_PPO = ("log_std_init", "log_std_final", "n_steps", "n_epochs", "target_kl")
_OF_SAC = ("buffer_size", "learning_starts", "gradient_steps")
Device = Annotated[str, one_of(("auto", "cpu", "cuda"))]
Minutes = Annotated[Positive | None, "M", {"instead_of": "settings.epochs"}]


class TrainingCommand(Command):
    """The training.

    Attributes:
        out: folder of the training; that of a policy is an agent by its path.
        device: where it is computed.
    """

    out: Folder
    device: Device = "cpu"

    def train(self, make: "Make", unit: str, out: Path, *, of: str = "", **options: Any) -> "Training":
        """Train behind a progress bar with the figures of the last epoch; draw the curves.

        Args:
            make: makes the training, given its folder and options.
            unit: of the bar.
            out: folder.
            of: suffix of the bar's label.
            **options: more fields of `RunOptions`.
        """
        from dexgrasp.learning.training.curves import draw_curves
        from dexgrasp.learning.training.loop import RunOptions

        name = type(self).__name__.lower()
        with resumable(f"the last checkpoint is kept in {out}"), progress_bar(unit, name + of) as bar:

            def show(state: "TrainingState") -> None:
                """Move the bar to the current epoch."""
                figures = self.figures(state.curve[-1])
                bar(state.epoch, state.epochs, **{key: shown(value) for key, value in figures.items()})

            training = make(out, RunOptions(self.device, **options))
            training.run(show)
        draw_curves(training.state.curve, out / "curves.png", training.best)
        return training

    def figures(self, row: Fields) -> Fields:
        """Return the figures of an epoch that the bar shows."""
        return {key: value for key, value in row.items() if key != "epoch" and value is not None}


class TrialOptions(Options):
    """Trials while it learns (seeds of their own: 0 to 99 are for tuning).

    Attributes:
        try_on: objects or sets (default: no trials).
        trials: on each.
        every: epochs, of reinforcement rounds, between trials.
    """

    try_on: Annotated[tuple[str, ...], "OBJECT"] = ()
    trials: Annotated[Count, {"of": "try_on"}] = 1
    every: Annotated[Count, {"of": "try_on"}] = 20


class PolicyCommand(TrainingCommand, TrialOptions):
    """The policy.

    Attributes:
        seeds: one or several, each a policy of its own in a folder seed-S.
    """

    seeds: Annotated[tuple[Natural, ...], "--seed", "S"] = (0,)

    def train_each(self, make: "Callable[..., Training]", unit: str, settings: Any, **options: Any) -> Answer:
        """Train a policy for each seed; return the figures of its last epoch.

        Args:
            make: makes the training, given settings, its folder and options.
            unit: of the bar.
            settings: of the training, the seed apart.
            **options: more of `RunOptions`.
        """
        if self.try_on:
            from dexgrasp.learning.training.trials import PeriodicTrials
            from dexgrasp_env.objects.load import resolve_targets

            options["trials"] = PeriodicTrials(
                tuple(resolve_targets(self.try_on)), self.trials, every=self.every
            )
        policies, seeds = list[Fields](), dict.fromkeys(self.seeds)
        for seed in seeds:
            out = self.out if len(seeds) == 1 else self.out / f"seed-{seed}"
            seeded = partial(make, replace(settings, seed=seed))
            state = self.train(seeded, unit, out, of=f", seed {seed}", **options).state
            policies.append({"policy": out, **state.curve[-1], "seconds": state.seconds})
        lines = [
            "; ".join(f"{key.replace('_', ' ')} {shown(value)}" for key, value in row.items())
            for row in policies
        ]
        return Answer({"policies": policies}, lines)


class Cvae(TrainingCommand):
    """Train the autoencoder that proposes fingertips.

    examples:
      dexgrasp train cvae --data runs/ycb6 --out runs/cvae --minutes 25
      dexgrasp train cvae --data runs/ycb6 --out runs/cvae --epochs 300 --held-out-object potted_meat_can --device cuda
      dexgrasp train cvae --data runs/ycb6 --out runs/cvae_wrench --minutes 25 --wrench-layer

    A run that was interrupted goes on when the same command is given again, on a CPU to the same bits. The folder of
    --out holds cvae.safetensors (the weights of the least test loss), checkpoint.safetensors, run.json, curve.jsonl,
    curves.png and tensorboard/. Weights are read by `dexgrasp.planning.cvae_source.CvaeProposals`.

    Attributes:
        data: of `dexgrasp dataset generate`.
        minutes: as many epochs as fit, by measured speed.
        device: where it is computed.
    """

    data: Folder
    settings: Annotated[TrainingSettings, _CVAE] = TrainingSettings()
    minutes: Minutes = None
    device: Device = "auto"

    def run(self) -> Answer:
        """Train; return the losses."""
        with from_extra():
            import torch  # noqa: F401  (what is missing first is named)

        from dexgrasp.learning.cvae.cvae_training import WEIGHTS, CvaeTraining

        make = partial(CvaeTraining, self.data, self.settings)
        training = self.train(make, "epoch", self.out, minutes=self.minutes)
        state, losses = training.state, training.state.curve[training.best - 1]
        figures = {
            "epochs": state.epochs, "best_epoch": training.best, "seconds": state.seconds, "losses": losses,
            "weights": self.out / WEIGHTS, "curves": self.out / "curves.png",
        }  # fmt: skip
        lines = [
            f"{split}: loss {values['total']:.4f}, fingertips {values['fingertip_cm']:.2f} cm, KL {values['kl']:.2f}"
            for split, values in losses.items()
            if isinstance(values, dict) and values
        ]
        epoch = f"epoch {training.best} of {state.epochs}, {state.seconds:.0f} s"
        return Answer(figures, [*lines, f"{epoch}; weights in {figures['weights']}"])

    def figures(self, row: Fields) -> Fields:
        """Return the training loss and the fingertip error on the test split, cm."""
        return {"train": row["train"]["total"], "test_cm": row["test"]["fingertip_cm"]}


class Bc(PolicyCommand):
    """Clone a policy from demonstrations.

    examples:
      dexgrasp demos generate --objects varied-0..99 --episodes 20 --noise 0.03 --out runs/demos --workers 2
      dexgrasp train bc --data runs/demos --out runs/bc --minutes 10
      dexgrasp train bc --data runs/demos --view cloud --out runs/bc_cloud --epochs 30 --seed 0 1 2
      dexgrasp train bc --data runs/demos --out runs/bc --epochs 20 --try-on seen --trials 3 --every 5
      dexgrasp evaluate --agents runs/bc bilevel --objects all20

    A policy sees the whole state and predicts the set-points of the next 8 control steps; or it looks at a cloud once,
    predicts how the object is grasped, and closes its hand until the joints feel contact. --out then holds policy.json
    and policy.safetensors: an agent by its path, wherever agents are named. A run that was interrupted goes on when the
    same command is given again, on a CPU to the same bits.

    Attributes:
        data: of `dexgrasp demos generate`.
        view: what the policy sees (default: what the demonstrations do).
        minutes: as many epochs as fit, by measured speed.
        every: epochs between trials.
    """

    data: tuple[Folder, ...]
    view: Annotated[str | None, one_of(("state", "cloud"))] = None
    settings: Annotated[BcSettings, _BC] = BcSettings()
    minutes: Minutes = None
    every: Annotated[Count, {"of": "try_on"}] = 5

    def run(self) -> Answer:
        """Train a policy for each seed; return losses and success rates."""
        from dexgrasp.data.demonstrations.generate import read_about
        from dexgrasp.learning.imitation.bc_training import VIEWS
        from dexgrasp.learning.imitation.settings import view_of

        view = self.view or view_of(str(read_about(self.data[0])["settings"].get("obs_mode")))
        settings = replace(self.settings, view=view)
        return self.train_each(partial(VIEWS[view], self.data), "epoch", settings, minutes=self.minutes)


class _Rl(PolicyCommand):
    """Reinforcement learning of a policy.

    Attributes:
        settings: of the training.
    """

    settings: RlSettings

    def run(self) -> Answer:
        """Train a policy for each seed; return returns and success rates."""
        from dexgrasp.learning.reinforcement.rl_training import RlTraining

        settings = replace(self.settings, algorithm=type(self).__name__.lower())
        return self.train_each(RlTraining, "round", settings)


class Ppo(_Rl):
    """Train a policy with PPO.

    examples:
      dexgrasp train ppo --objects seen --env-id DexGrasp/LiftStaged-v0 --resets runs/demos --out runs/ppo
      dexgrasp train ppo --objects sugar_box --control-mode ee_delta --resets runs/demos --out runs/ppo_demos
      dexgrasp train ppo --objects seen --env-id DexGrasp/LiftPushed-v2 --randomise mass=0.8:1.2 --out runs/ppo_pushed
      dexgrasp evaluate --agents runs/ppo hardcoded --objects seen --protocol lift pushed slippery
      dexgrasp train ppo --objects all20 --backend warp --device cuda --num-envs 4096 --out runs/ppo_gpu
      dexgrasp evaluate --agents runs/ppo_gpu --objects all20 --protocol lift lift@warp

    Stable-Baselines3's algorithm on the native vector environment: features in, dense reward. With --resets episodes
    begin along demonstrations, backwards from success. A run that was interrupted goes on when the same command is
    given again; rounds have seeds of their own, so that on a CPU it goes on to the same bits.
    """

    settings: Annotated[RlSettings, {"algorithm", "seed", *_OF_SAC}]


class Sac(_Rl):
    """Train a policy with SAC.

    examples:
      dexgrasp train sac --objects seen --env-id DexGrasp/LiftOnce-v0 --steps 6000 --out runs/sac --seed 0 1 2

    All else is as of `dexgrasp train ppo`, whose help says more.
    """

    settings: Annotated[RlSettings, {"algorithm", "seed", *_OF_PPO}]


COMMANDS = {"cvae": Cvae, "bc": Bc, "ppo": Ppo, "sac": Sac}
