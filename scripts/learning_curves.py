"""Learning curves over several seeds: their mean, and the range from the worst seed to the best.

    python scripts/learning_curves.py runs/bc/seed-* --figure docs/images/bc_curves.png --json docs/bc_curves.json

Runs are folders of `dexgrasp train bc | grip | ppo | sac`, of the same settings but for the seed. The JSON holds the
rows of every seed, and the wall time of each without its trials.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.runs.arrays import read_arrays
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import write_json

_PANELS = {
    "loss": {"loss": "trained on", "test_loss": "held out"},
    "return": {"return": "of a round's episodes"},
    "lifted and held": {
        "success": "trials", "training_success": "a round's episodes", "training_held": "held, a round's episodes"
    },
}  # fmt: skip
"""Title -> column of the curve -> what the legend calls it."""


def read_runs(folders: Sequence[Path]) -> dict[str, Any]:
    """Return settings and, of every seed, time and curve.

    Raises:
        InputError: if the trainings differ by more than their seeds.
    """
    settings, seeds = [], []
    for folder in folders:
        run = json.loads((folder / "training.json").read_text())
        _, note = read_arrays(folder / "checkpoint.safetensors")
        progress = note["progress"]
        seeds.append({"seed": run["settings"].pop("seed"), **{k: progress[k] for k in ("seconds", "curve")}})
        settings.append({"settings": run["settings"], "trials": run["trials"]})
    if any(one != settings[0] for one in settings[1:]):
        raise InputError("these trainings differ by more than their seeds: draw them apart")
    return {"schema": 1, **settings[0], "seeds": seeds}


def over_seeds(seeds: Sequence[Mapping[str, Any]], column: str) -> tuple[Array, Array]:
    """Return epochs (E,) at which every seed has a value, and the values (S, E)."""
    found = [
        {row["epoch"]: row[column] for row in one["curve"] if row.get(column) is not None} for one in seeds
    ]
    epochs = sorted(set.intersection(*(set(values) for values in found)))
    return np.array(epochs), np.array([[values[epoch] for epoch in epochs] for values in found])


def draw(runs: Mapping[str, Any], path: Path) -> None:
    """Draw what there is of losses, returns and successes."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    panels = {}
    for title, columns in _PANELS.items():
        drawn = {label: over_seeds(runs["seeds"], column) for column, label in columns.items()}
        panels[title] = {label: points for label, points in drawn.items() if len(points[0])}
    panels = {title: lines for title, lines in panels.items() if lines}
    figure, axes = plt.subplots(
        1, len(panels), figsize=(4.5 * len(panels), 3.2), layout="constrained", squeeze=False
    )
    for axis, (title, lines) in zip(axes[0], panels.items(), strict=True):
        for label, (epochs, values) in lines.items():
            axis.plot(epochs, values.mean(axis=0), lw=1.2, marker=".", label=label)
            axis.fill_between(epochs, values.min(axis=0), values.max(axis=0), alpha=0.2)
        axis.set(xlabel="epoch or round", title=title)
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7)
        if title == "loss":
            axis.set_yscale("log")
        elif title == "lifted and held":
            axis.set_ylim(0.0, 1.02)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def main(arguments: Sequence[str] | None = None) -> None:
    """Read, write, draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", nargs="+", type=Path, metavar="DIR", help="folders of trainings, one a seed")
    parser.add_argument("--figure", type=Path, required=True, metavar="PNG")
    parser.add_argument("--json", type=Path, metavar="FILE", help="the figures behind it")
    args = parser.parse_args(arguments)
    runs = read_runs(args.runs)
    if args.json:
        write_json(args.json, runs)
    draw(runs, args.figure)


if __name__ == "__main__":
    main()
