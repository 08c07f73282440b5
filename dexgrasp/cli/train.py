"""Train networks: the learned half of the paper, policies cloned from demonstrations or reinforced.

examples:
  dexgrasp train cvae --data runs/ycb6 --out runs/cvae --minutes 25
  dexgrasp train bc --data runs/demos --out runs/bc --minutes 10
  dexgrasp train grip --objects varied-0..59 --from runs/bc --out runs/grip
  dexgrasp train ppo --objects varied-0..29 --from runs/bc --out runs/ppo
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
from dexgrasp.cli.figures import shown
from dexgrasp.cli.output import resumable
from dexgrasp.learning.cvae.settings import TrainingSettings
from dexgrasp.learning.imitation.settings import BcSettings
from dexgrasp.learning.reinforcement.settings import GripSettings, RlSettings
from dexgrasp.runs.progress import progress_bar
from dexgrasp_env.arrays import Fields
from dexgrasp_env.extras import from_extra
from dexgrasp_env.valid import Count, Natural, Positive, one_of

if TYPE_CHECKING:
    from dexgrasp.learning.training.loop import Progress, Training

_CVAE = ("epochs", "seed", "threads", "latent", "kl_weight", "wrench_layer", "held_out_object")
_BC = ("epochs", "threads", "hidden", "chunk", "execute")
_GRIP = ("objects", "episodes", "friction", "mass", "num_envs", "learning_rate", "threads")
_OF_PPO = ("log_std_init", "log_std_final", "noise", "n_steps", "n_epochs", "target_kl", "adaptive")
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

    def train(
        self,
        loop: "type[Training]",
        task: Callable[[], Any],
        unit: str,
        *,
        of: str = "",
        out: Path | None = None,
        **options: Any,
    ) -> "Training":
        """Train behind a bar that shows the figures of the last epoch; draw the curves.

        Args:
            loop: that trains.
            task: makes what is trained.
            unit: of the bar.
            of: what the bar says besides the command's name.
            out: folder, where it is not that of the command.
            **options: more of `RunOptions`.
        """
        from dexgrasp.learning.training.curves import draw_curves
        from dexgrasp.learning.training.loop import RunOptions

        folder, name = out or self.out, type(self).__name__.lower()
        with resumable(f"the last checkpoint is kept in {folder}"), progress_bar(unit, name + of) as bar:

            def show(state: "Progress") -> None:
                """Move the bar to the present epoch."""
                bar(
                    state.epoch,
                    state.epochs,
                    **{key: shown(value) for key, value in self.figures(state.curve[-1]).items()},
                )

            training: Any = loop(task(), folder, RunOptions(self.device, **options))  # type: ignore[call-arg]
            training.run(show)
        draw_curves(training.state.curve, folder / "curves.png", training.best)
        return training

    def figures(self, row: Fields) -> Fields:
        """Return what the bar shows of the line of an epoch."""
        return {key: value for key, value in row.items() if key != "epoch" and value is not None}


class Tried(Options):
    """Trials while it learns (seeds of their own: 0 to 99 are for tuning).

    Attributes:
        try_on: objects or sets (default: no trials).
        trials: on each.
        every: epochs, of reinforcement rounds, between trials.
    """

    try_on: Annotated[tuple[str, ...], "OBJECT"] = ()
    trials: Count = 1
    every: Count = 20


class PolicyCommand(TrainingCommand, Tried):
    """The policy.

    Attributes:
        seeds: one or several, each a policy of its own in a folder seed-S.
    """

    seeds: Annotated[tuple[Natural, ...], "--seed", "S"] = (0,)

    def train_each(
        self, loop: "type[Training]", task: Callable[..., Any], unit: str, settings: Any, **options: Any
    ) -> Answer:
        """Train a policy for each seed, return the figures of its last epoch.

        Args:
            loop: that trains.
            task: given settings, makes what is trained.
            unit: of the bar.
            settings: of the training, the seed apart.
            **options: more of `RunOptions`.
        """
        tester = None
        if self.try_on:
            from dexgrasp.learning.imitation.trials import Trials
            from dexgrasp_env.objects.load import resolve_targets

            tester = Trials(tuple(resolve_targets(self.try_on)), self.trials, every=self.every)
        policies, seeds = list[Fields](), dict.fromkeys(self.seeds)
        for seed in seeds:
            out = self.out if len(seeds) == 1 else self.out / f"seed-{seed}"
            seeded = partial(task, settings=replace(settings, seed=seed))
            state = self.train(
                loop, seeded, unit, of=f", seed {seed}", out=out, tester=tester, **options
            ).state
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
        """Train, return the losses."""
        with from_extra():
            import torch  # noqa: F401  (what is missing first is named)

        from dexgrasp.learning.cvae.cvae_task import WEIGHTS, CvaeTask
        from dexgrasp.learning.training.gradient_training import GradientTraining

        task = partial(CvaeTask, self.data, self.settings)
        training = self.train(GradientTraining, task, "epoch", minutes=self.minutes)
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
        """Return the losses."""
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
    every: Count = 5

    def run(self) -> Answer:
        """Train a policy for each seed, return losses and successes."""
        from dexgrasp.data.demonstrations.generate import read_about
        from dexgrasp.learning.imitation.bc_tasks import VIEWS
        from dexgrasp.learning.imitation.settings import view_of
        from dexgrasp.learning.training.gradient_training import GradientTraining

        view = self.view or view_of(str(read_about(self.data[0])["settings"].get("obs_mode")))
        settings = replace(self.settings, view=view)
        task = partial(VIEWS[view], self.data)
        return self.train_each(GradientTraining, task, "epoch", settings, minutes=self.minutes)


class Grip(PolicyCommand):
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
        from dexgrasp.learning.reinforcement.rl_tasks import GripTask
        from dexgrasp.learning.reinforcement.rollout_training import RolloutTraining

        task = partial(GripTask, clone=self.clone)
        return self.train_each(RolloutTraining, task, "round", self.settings)


class _Rl(PolicyCommand):
    """Reinforcement learning of a policy.

    Attributes:
        settings: of the training.
        clone: a policy of `train bc` to begin with.
    """

    settings: RlSettings
    clone: Annotated[Folder | None, "--from"] = None

    def run(self) -> Answer:
        """Train a policy for each seed, return returns and successes."""
        from dexgrasp.learning.reinforcement.rl_tasks import PolicyTask
        from dexgrasp.learning.reinforcement.rollout_training import RolloutTraining

        settings = replace(self.settings, algorithm=type(self).__name__.lower())
        task = partial(PolicyTask, clone=self.clone)
        return self.train_each(RolloutTraining, task, "round", settings)


class Ppo(_Rl):
    """Train a policy with PPO.

    examples:
      dexgrasp train ppo --objects sugar_box --steps 2000000 --out runs/ppo
      dexgrasp train ppo --objects varied-0..29 --from runs/bc --steps 500000 --out runs/ppo_bc --try-on seen
      dexgrasp train ppo --objects sugar_box --control-mode ee_delta --resets runs/demos --out runs/ppo_demos
      dexgrasp train ppo --objects seen --env-id DexGrasp/LiftPushed-v2 --randomise mass=0.8:1.2 --out runs/ppo_pushed
      dexgrasp evaluate --agents runs/ppo_bc runs/bc --objects all20 --protocol lift pushed slippery
      dexgrasp train ppo --objects all20 --backend warp --device cuda --num-envs 4096 --out runs/ppo_gpu
      dexgrasp evaluate --agents runs/ppo_gpu --objects all20 --protocol lift lift@warp

    Stable-Baselines3's algorithm on the native vector environment, dense reward. With --from, a cloned policy acts and
    a share of the network's action is added to its own: what it can do already is the start. A run that was interrupted
    goes on when the same command is given again; rounds (one episode of every environment) have seeds of their own, so
    that on a CPU it goes on to the same bits.
    """

    settings: Annotated[RlSettings, {"algorithm", "seed", *_OF_SAC}]


class Sac(_Rl):
    """Train a policy with SAC.

    examples:
      dexgrasp train sac --objects seen --from runs/bc --residual-scale 0.1 --out runs/sac_bc --seed 0 1 2

    All else is as of `dexgrasp train ppo`, whose help says more.
    """

    settings: Annotated[RlSettings, {"algorithm", "seed", *_OF_PPO}]


COMMANDS = {"cvae": Cvae, "bc": Bc, "grip": Grip, "ppo": Ppo, "sac": Sac}
