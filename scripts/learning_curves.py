"""Learning curves of trainings, as small JSON and a picture: what was tried, how often it held, with 95 % intervals.

    python scripts/learning_curves.py runs/bc/seed-0 runs/bc/seed-1 runs/bc/seed-2 --out docs/curves/bc

Runs are folders of `dexgrasp train bc | grip | ppo | sac`, one a seed.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents.evaluation.statistics import wilson_interval
from agents.learning.decoder import read_arrays
from dexgrasp_env.files import write_json

_RATES = ("success", "training_held", "training_success")


def read_run(folder: Path) -> dict[str, Any]:
    """Return settings and curve of a training; rows with a rate get its Wilson interval where the trials are known."""
    _, note = read_arrays(folder / "checkpoint.safetensors")
    progress = note.get("progress", note)
    run = json.loads((folder / "training.json").read_text())
    settings = run["settings"]
    round_episodes = settings.get("round_episodes", 1) * settings.get("num_envs", 0)
    for row in progress["curve"]:
        for name in _RATES:
            number = row.get("trials", 0) if name == "success" else round_episodes
            if row.get(name) is not None and number:
                row[f"{name}_ci95"] = list(wilson_interval(round(row[name] * number), number))
    return {
        "settings": settings,
        "trials": run["trials"],
        "seconds": progress["seconds"],
        "curve": progress["curve"],
    }


def draw(runs: Sequence[dict[str, Any]], path: Path) -> None:
    """Draw the rates of every run over its epochs or rounds."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6, 3.5), layout="constrained")
    for run in runs:
        for name in _RATES:
            rows = [row for row in run["curve"] if row.get(name) is not None]
            if not rows:
                continue
            epochs, rates = [row["epoch"] for row in rows], [row[name] for row in rows]
            (line,) = axis.plot(
                epochs, rates, marker=".", label=f"{name.replace('_', ' ')}, seed {run['settings']['seed']}"
            )
            bounds = [row.get(f"{name}_ci95", [row[name]] * 2) for row in rows]
            axis.fill_between(epochs, *zip(*bounds, strict=True), color=line.get_color(), alpha=0.15)
    axis.set(xlabel="epoch or round", ylim=(0.0, 1.02))
    axis.grid(alpha=0.3)
    axis.legend(fontsize=7)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def main(arguments: Sequence[str] | None = None) -> None:
    """Read, write, draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", nargs="+", type=Path, metavar="DIR", help="folders of trainings")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="STEM", help="STEM.json and STEM.png are written"
    )
    args = parser.parse_args(arguments)
    runs = [read_run(folder) for folder in args.runs]
    args.out.parent.mkdir(parents=True, exist_ok=True)
    write_json(args.out.with_suffix(".json"), {"schema": 1, "runs": runs})
    draw(runs, args.out.with_suffix(".png"))


if __name__ == "__main__":
    main()
