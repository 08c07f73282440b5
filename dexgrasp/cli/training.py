"""What the commands that train have in common: where, a bar, curves."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from dexgrasp.cli.command import Command, Folder
from dexgrasp.cli.figures import shown
from dexgrasp.cli.output import resumable
from dexgrasp.runs.progress import progress_bar
from dexgrasp_env.valid import one_of

if TYPE_CHECKING:
    from dexgrasp.runs.training import Progress, Training

Device = Annotated[str, one_of(("auto", "cpu", "cuda"))]
Figures = Callable[["Progress"], dict[str, Any]]


class TrainingCommand(Command):
    """The training.

    Attributes:
        out: folder of the training; that of a policy is an agent by its path.
        device: where it is computed.
    """

    out: Folder
    device: Device = "cpu"


def run_training(
    make: "Callable[[], Training]", out: Path, unit: str, of: str, figures: Figures
) -> "Training":
    """Make and run a training in `out` behind a bar of `unit`s that shows `figures`; draw its curves."""
    from dexgrasp.runs.curves import draw_curves

    with resumable(f"the last checkpoint is kept in {out}"), progress_bar(unit, of) as bar:
        training = make()
        training.run(
            lambda state: bar(state.epoch, state.epochs, **{k: shown(v) for k, v in figures(state).items()})
        )
    draw_curves(training.state.curve, out / "curves.png", training.best)
    return training
