"""Learning curves as a picture."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

_PANELS = (("loss", "test_loss"), ("return",), ("success", "training_success", "training_held"))


def draw(curve: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Draw what there is of losses, returns and successes over epochs or rounds."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    panels = [names for names in _PANELS if any(row.get(name) is not None for row in curve for name in names)]
    figure, axes = plt.subplots(
        1, len(panels), figsize=(4.5 * len(panels), 3.2), layout="constrained", squeeze=False
    )
    for axis, names in zip(axes[0], panels, strict=True):
        for name in names:
            points = [(row["epoch"], row[name]) for row in curve if row.get(name) is not None]
            if points:
                axis.plot(*zip(*points, strict=True), lw=1, marker=".", label=name.replace("_", " "))
        axis.set(xlabel="epoch or round", title=names[0].replace("_", " "))
        if names[0] == "loss":
            axis.set_yscale("log")
        elif names[0] == "success":
            axis.set_ylim(0.0, 1.05)
        axis.grid(alpha=0.3)
        if axis.lines:
            axis.legend(fontsize=7)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)
    plt.close(figure)
