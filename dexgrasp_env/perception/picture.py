"""A picture for people: a scene with all that is seen in it, its hull, and what is known of hand and true object."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dexgrasp_env.arrays import Array, middle

if TYPE_CHECKING:
    from dexgrasp_env.perception.plane import Plane

_SIDES = {"from above": (0, 1), "from the right": (0, 2), "from the front": (1, 2)}


def save(figure: Any, path: Path) -> Path:
    """Write a figure as PNG, and return the path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    return path


@dataclass(frozen=True, eq=False)
class Drawing:
    """Things of a scene for a picture; whatever is not there is left out. All in the frame of the scene, m.

    Attributes:
        objects: points (N, 3) of each object by its line of the legend, the one that is meant first.
        rest: (N, 3) points of what is no object.
        plane: the table.
        hull: (F, 3, 3) triangles that the object is taken for.
        solids: (F, 3, 3) triangles of what is known of the hand, or of the true object, by its line of the legend.
        title: above the picture.
    """

    objects: dict[str, Array]
    rest: Array
    plane: "Plane | None" = None
    hull: Array | None = None
    solids: dict[str, Array] = field(default_factory=dict)
    title: str = ""


def scene_picture(path: Path, drawing: Drawing) -> Path:
    """Draw a scene from above, from the front and from the side, and write it as PNG; the robot is to the left.

    Flat projections: they need neither OpenGL nor the time of drawings in space.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(15.0, 6.0))
    seen = [points for points in drawing.objects.values() if len(points)]
    about = np.concatenate(seen or [drawing.rest, np.zeros((1, 3))])
    shown = [*drawing.solids.values(), np.zeros((0, 3)) if drawing.hull is None else drawing.hull]
    about = np.concatenate([about, *(triangles.reshape(-1, 3) for triangles in shown)])
    margin = 0.03  # m around what is drawn
    low, high = about.min(0) - margin, about.max(0) + margin
    for k, (name, axes) in enumerate(_SIDES.items()):
        panel = figure.add_subplot(1, len(_SIDES), k + 1, aspect="equal", title=name)
        _draw_side(panel, drawing, list(axes), low, high)
    figure.legend(
        *panel.get_legend_handles_labels(),
        loc="lower left",
        ncols=2,
        frameon=False,
        fontsize=8,
        markerscale=8,
    )
    figure.suptitle(drawing.title)
    figure.subplots_adjust(left=0.05, right=0.98, top=0.9, bottom=0.3)
    return save(figure, path)


def _draw_side(panel: Any, drawing: Drawing, axes: list[int], low: Array, high: Array) -> None:
    """Draw the projection of everything onto two axes."""
    from matplotlib.collections import LineCollection, PolyCollection

    if drawing.plane is not None:
        x, y = low[[0, 0, 0, 0]], low[[1, 1, 1, 1]]
        x[2:], y[1:3] = high[0], high[1]
        n, offset = drawing.plane.normal, drawing.plane.offset
        table = np.stack([x, y, (offset - n[0] * x - n[1] * y) / n[2]], axis=1)
        table_colour = "#e8dcc8"
        panel.add_collection(
            PolyCollection([table[:, axes]], facecolor=table_colour, edgecolor=table_colour, label="table")
        )
    for words, triangles in drawing.solids.items():
        panel.add_collection(
            PolyCollection(list(triangles[..., axes]), facecolor="0.2", alpha=0.12, label=words)
        )
    panel.plot(*drawing.rest[:, axes].T, ".", markersize=1, color="0.6", label="no object")
    for number, (words, points) in enumerate(drawing.objects.items(), start=1):
        panel.plot(*points[:, axes].T, ".", markersize=1.5, label=words)
        panel.annotate(str(number), middle(points)[axes], fontsize=14, ha="center", va="center")
    if drawing.hull is not None:
        triangles = drawing.hull[:, [0, 1, 2, 0]][..., axes]
        panel.add_collection(
            LineCollection(list(triangles), colors="k", linewidths=0.3, label="what is planned on")
        )
    for which, axis in zip("xy", axes, strict=True):
        panel.set(**{f"{which}lim": (low[axis], high[axis]), f"{which}label": f"{'xyz'[axis]}, m"})
