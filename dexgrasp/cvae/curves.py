"""Training curves as a picture, as Figure 1 of the supplementary shows them."""

import json
from pathlib import Path
from typing import Any

from dexgrasp.cvae.batches import SPLITS


def draw_curves(curve: list[dict[str, Any]], best_epoch: int, path: Path) -> None:
    """Draw loss and fingertip error of every split over epochs.

    Args:
        curve: rows of `Progress.curve`.
        best_epoch: marked.
        path: of the PNG.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    epochs = [row["epoch"] for row in curve]
    for axis, name, title in (
        (axes[0], "total", "loss"),
        (axes[1], "fingertip_cm", "fingertip reconstruction, cm"),
    ):
        for split in SPLITS:
            if curve and curve[-1].get(split):
                axis.plot(epochs, [row[split][name] for row in curve], lw=1, label=split.replace("_", " "))
        axis.axvline(best_epoch, color="grey", lw=0.7, ls=":")
        axis.set(xlabel="epoch (50 steps)", title=title, yscale="log")
        axis.grid(alpha=0.3, which="both")
    axes[1].axhline(1.0, color="black", lw=0.7, ls="--", label="1 cm")
    axes[1].legend(fontsize=7)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def write_curve(curve: list[dict[str, Any]], path: Path) -> None:
    """Write the rows as JSON lines."""
    path.write_text("".join(json.dumps(row) + "\n" for row in curve))
