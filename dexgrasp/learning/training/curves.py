"""Learning curves: figures of epochs as a picture, and as numbers."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from dexgrasp_env.arrays import Fields

_PANELS = {
    "loss": ("loss", "test_loss", "total"),
    "fingertip reconstruction, cm": ("fingertip_cm",),
    "return": ("return",),
    "success": ("success", "training_success"),
}
"""Title of a panel -> figures that are drawn in it."""


def scalars(row: Fields) -> Iterator[tuple[str, str, float]]:
    """Yield name, split and value of the numbers of a row; the split is "" for figures without splits."""
    for key, value in row.items():
        for name, number in value.items() if isinstance(value, Mapping) else [("", value)]:
            if isinstance(number, int | float):
                yield (name, key, number) if name else (key, "", number)


def draw_curves(curve: Sequence[Fields], path: Path, best: int) -> None:
    """Draw losses, errors, returns and success rates, as far as the curve has them.

    Args:
        curve: a row for each epoch; a figure may be a mapping by split of the data.
        path: of the picture.
        best: epoch to mark; 0 for none.
    """
    from matplotlib.figure import Figure

    figure = Figure((4.5 * len(_PANELS), 3.3), layout="constrained")
    for axis, (title, names) in zip(figure.subplots(1, len(_PANELS)), _PANELS.items(), strict=True):
        lines: dict[str, list[tuple[int, float]]] = {}
        for row in curve:
            for name, split, number in scalars(row):
                if name in names:
                    lines.setdefault(split or name, []).append((row["epoch"], number))
        for label, points in lines.items():
            axis.plot(*zip(*points, strict=True), lw=1, marker=".", markersize=3, label=label)
        axis.set(xlabel="epoch or round", title=title, visible=bool(lines))
        axis.grid(alpha=0.3)
        if best:
            axis.axvline(best, color="grey", lw=0.7, ls=":")
        if lines:
            axis.legend(fontsize=7)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)
