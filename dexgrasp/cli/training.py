"""What the commands that train have in common: where, trials, a bar, curves."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from dexgrasp.cli.command import Answer, Command, Folder, Options
from dexgrasp.cli.figures import shown
from dexgrasp.cli.output import resumable
from dexgrasp.runs.progress import progress_bar
from dexgrasp_env.arrays import Fields
from dexgrasp_env.extras import require_extra
from dexgrasp_env.valid import Count, Natural, one_of

if TYPE_CHECKING:
    from dexgrasp.imitation.trials import Trials
    from dexgrasp.runs.training import Progress, Training

Device = Annotated[str, one_of(("auto", "cpu", "cuda"))]


class TrainingCommand(Command):
    """The training.

    Attributes:
        out: folder of the training; that of a policy is an agent by its path.
        device: where it is computed.
    """

    out: Folder
    device: Device = "cpu"

    def run(self) -> Answer:
        """Train."""
        require_extra("learning", "training")
        return self.learn()

    def learn(self) -> Answer:
        """Train, where all is there that it takes; return the figures."""
        raise NotImplementedError

    def train(
        self,
        make: "Callable[..., Training]",
        unit: str,
        *,
        of: str = "",
        out: Path | None = None,
        **course: Any,
    ) -> "Training":
        """Train behind a bar that shows the figures of the last epoch; draw the curves.

        Args:
            make: given a folder and a course, makes the training.
            unit: of the bar.
            of: what the bar says besides the command's name.
            out: folder, where it is not that of the command.
            **course: what the course has beside the device.
        """
        from dexgrasp.runs.curves import draw_curves
        from dexgrasp.runs.training import Course

        folder, name = out or self.out, type(self).__name__.lower()
        with resumable(f"the last checkpoint is kept in {folder}"), progress_bar(unit, name + of) as bar:

            def show(state: "Progress") -> None:
                """Move the bar to the present epoch."""
                bar(
                    state.epoch,
                    state.epochs,
                    **{key: shown(value) for key, value in self.figures(state.curve[-1]).items()},
                )

            training = make(out=folder, course=Course(self.device, **course))
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

    @property
    def tester(self) -> "Trials | None":
        """What tries a policy while it learns; None for nothing."""
        if not self.try_on:
            return None
        from dexgrasp.imitation.trials import Trials
        from dexgrasp_env.objects.load import resolve_targets

        return Trials(tuple(resolve_targets(self.try_on)), self.trials, every=self.every)


class PolicyCommand(TrainingCommand, Tried):
    """The policy.

    Attributes:
        seeds: one or several, each a policy of its own in a folder seed-S.
    """

    seeds: Annotated[tuple[Natural, ...], "--seed", "S"] = (0,)

    def train_each(self, make: "Callable[..., Training]", unit: str, settings: Any, **course: Any) -> Answer:
        """Train a policy for each seed, return the figures of its last epoch.

        Args:
            make: given a folder, settings and a course, makes the training.
            unit: of the bar.
            settings: of the training, the seed apart.
            **course: what the course has beside device and trials.
        """
        policies, seeds = list[Fields](), dict.fromkeys(self.seeds)
        for seed in seeds:
            out = self.out if len(seeds) == 1 else self.out / f"seed-{seed}"
            seeded = partial(make, settings=replace(settings, seed=seed))
            state = self.train(seeded, unit, of=f", seed {seed}", out=out, tester=self.tester, **course).state
            policies.append({"policy": str(out), **state.curve[-1], "seconds": state.seconds})
        lines = (
            "; ".join(f"{key.replace('_', ' ')} {shown(value)}" for key, value in row.items())
            for row in policies
        )
        return Answer({"policies": policies}, "\n".join(lines))
