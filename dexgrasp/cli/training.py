"""What the commands that train have in common: options, seeds, a bar, the figures at the end."""

import argparse
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dexgrasp.cli.options import natural_int, positive_float, positive_int

if TYPE_CHECKING:
    from dexgrasp.imitation.settings import BcSettings
    from dexgrasp.imitation.trials import Trials
    from dexgrasp.reinforcement.grip_settings import GripSettings
    from dexgrasp.reinforcement.settings import RlSettings
    from dexgrasp.runs.training import Progress, Training

    Settings = BcSettings | GripSettings | RlSettings


def add_length(parser: argparse.ArgumentParser, steps: int, epochs: int) -> None:
    """Add `--epochs` and `--minutes`."""
    length = parser.add_mutually_exclusive_group()
    length.add_argument(
        "--epochs", type=positive_int, metavar="N", help=f"of {steps} steps each (default {epochs})"
    )
    length.add_argument(
        "--minutes", type=positive_float, metavar="M", help="as many epochs as fit, by measured speed"
    )


def add_torch(parser: argparse.ArgumentParser, device: str = "cpu") -> None:
    """Add `--device` and `--threads`."""
    parser.add_argument(
        "--device", choices=("auto", "cpu", "cuda"), default=device, help=f"(default {device})"
    )
    parser.add_argument(
        "--threads", type=positive_int, default=1, metavar="N", help="of torch on the CPU (default 1)"
    )


def add_seeds(parser: argparse.ArgumentParser) -> None:
    """Add `--seed`."""
    parser.add_argument(
        "--seed", type=natural_int, nargs="+", default=[0], metavar="S", help="one or several (default 0)"
    )


def add_trials(parser: argparse.ArgumentParser, every: int, unit: str) -> None:
    """Add `--try-on`, `--trials` and `--every`, the last counted in `unit`."""
    trials = parser.add_argument_group("trials while it learns (seeds of their own: 0 to 99 are for tuning)")
    trials.add_argument("--try-on", nargs="+", metavar="OBJECT", help="objects or sets (default: no trials)")
    trials.add_argument("--trials", type=positive_int, default=1, metavar="N", help="on each (default 1)")
    trials.add_argument(
        "--every", type=positive_int, default=every, metavar="N", help=f"{unit}s (default {every})"
    )


def train_each_seed(
    args: argparse.Namespace, unit: str, settings: "Settings", make: "Callable[..., Training]"
) -> int:
    """Train a policy for each seed; draw its curves, print the figures of its last epoch.

    Args:
        args: with all options of this module, `--out` and `--json`.
        unit: of the bar.
        settings: of the training, the seed apart.
        make: given a folder, settings and a course, makes the training.
    """
    from dexgrasp.cli.output import print_json
    from dexgrasp.runs.training import Course

    course = Course(args.device, getattr(args, "minutes", None), _trials(args))
    results = []
    for seed in dict.fromkeys(args.seed):
        out = args.out if len(set(args.seed)) == 1 else args.out / f"seed-{seed}"
        training = partial(make, out=out, settings=replace(settings, seed=seed), course=course)
        state = run_training(training, out, unit, f"{args.train_command}, seed {seed}", _last_figures).state
        results.append({"policy": str(out), **state.curve[-1], "seconds": state.seconds})
    if args.json:
        print_json({"schema": 1, "policies": results})
        return 0
    for figures in results:
        print("; ".join(f"{key.replace('_', ' ')} {_shown(value)}" for key, value in figures.items()))
    return 0


def _trials(args: argparse.Namespace) -> "Trials | None":
    from dexgrasp.imitation.trials import Trials
    from dexgrasp_env.objects.load import resolve_targets

    if not args.try_on:
        return None
    return Trials(tuple(resolve_targets(args.try_on)), args.trials, every=args.every)


def run_training(
    make: "Callable[[], Training]",
    out: Path,
    unit: str,
    of: str,
    figures: "Callable[[Progress], dict[str, str]]",
) -> "Training":
    """Make and run a training in `out` behind a bar of `unit`s that shows `figures`; draw its curves."""
    from dexgrasp.cli.output import resumable
    from dexgrasp.runs.curves import draw_curves
    from dexgrasp.runs.progress import progress_bar

    with resumable(f"the last checkpoint is kept in {out}"), progress_bar(unit, of) as bar:
        training = make()
        training.run(lambda state: bar(state.epoch, state.epochs, **figures(state)))
    draw_curves(training.state.curve, out / "curves.png", training.best)
    return training


def _last_figures(state: "Progress") -> dict[str, str]:
    last = state.curve[-1]
    return {key: _shown(value) for key, value in last.items() if key != "epoch" and value is not None}


def _shown(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
