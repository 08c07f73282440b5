"""Learning curves as a picture."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

_PANELS = (("loss", "test_loss"), ("success",))


def draw(curve: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Draw losses, and successes where there were trials, over epochs."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(_PANELS), figsize=(9, 3.2), layout="constrained")
    for axis, names in zip(axes, _PANELS, strict=True):
        for name in names:
            points = [(row["epoch"], row[name]) for row in curve if row.get(name) is not None]
            if points:
                axis.plot(*zip(*points, strict=True), lw=1, marker=".", label=name.replace("_", " "))
        axis.set(xlabel="epoch", title=names[0])
        axis.grid(alpha=0.3)
        if axis.lines:
            axis.legend(fontsize=7)
    axes[0].set_yscale("log")
    axes[1].set_ylim(0.0, 1.05)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)
    plt.close(figure)
