"""Pictures for people: the cloud with its hull and the true mesh, a scene with all that is seen in it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, middle

if TYPE_CHECKING:
    import trimesh

    from dexgrasp_env.perception.plane import Plane

_SIDES = {"from above": (0, 1), "from the right": (0, 2), "from the front": (1, 2)}
_MARGIN = 0.03  # m around what is drawn
_TABLE = "#e8dcc8"
_VIEWS = (("from the front right", 25, -40), ("from the back left", 25, 140), ("from above", 90, -90))


def cloud_picture(
    path: Path,
    points: NDArray[Any],
    hull: "trimesh.Trimesh | None",
    true_mesh: "trimesh.Trimesh | None" = None,
    title: str = "",
) -> Path:
    """Draw three views of what was seen over what is there, and write them as PNG.

    Args:
        path: file to write.
        points: (M, 3) m, world frame; see `ObjectCloud`.
        hull: the cloud's hull in the same frame, or None.
        true_mesh: the true surface in the same frame, or None to leave it out.
        title: above the picture.

    Returns:
        The path.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.5, 4.4))
    for k, (name, elevation, azimuth) in enumerate(_VIEWS):
        axes = figure.add_subplot(1, 3, k + 1, projection="3d", computed_zorder=False)
        _draw(axes, np.asarray(points, float), hull, true_mesh)
        axes.view_init(elevation, azimuth)
        axes.set_title(name, fontsize=10, y=0.98)
        if elevation == 90:
            axes.set_proj_type("ortho")
            axes.set(zticks=[], zlabel="")
    figure.legend(*axes.get_legend_handles_labels(), loc="lower center", ncols=3, frameon=False)
    figure.suptitle(title or f"{len(points)} points", y=0.985)
    figure.subplots_adjust(left=0.01, right=0.97, bottom=0.10, top=0.88, wspace=0.08)
    return save(figure, path)


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
        around: (N, 3) corners of each convex part of what is kept clear of.
        hand: (F, 3, 3) triangles of the hand where it grasps.
        title: above the picture.
    """

    objects: dict[str, Array]
    rest: Array
    plane: "Plane | None" = None
    hull: Array | None = None
    around: Sequence[Array] = ()
    hand: Array | None = None
    title: str = ""


def scene_picture(path: Path, drawing: Drawing) -> Path:
    """Draw a scene from above, from the front and from the side, and write it as PNG; the robot is to the left.

    Flat projections: they need neither OpenGL nor the time of drawings in space.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(15.0, 6.0))
    seen = [points for points in drawing.objects.values() if len(points)]
    about = np.concatenate(seen or [drawing.rest, np.zeros((1, 3))])
    solids = [solid.reshape(-1, 3) for solid in (drawing.hand, drawing.hull) if solid is not None]
    about = np.concatenate([about, *solids])
    low, high = about.min(0) - _MARGIN, about.max(0) + _MARGIN
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
        x, y = (np.array([low[k], high[k]]) for k in (0, 1))
        square = np.array([(a, b, 0.0) for a, b in ((0, 0), (0, 1), (1, 1), (1, 0))])
        square[:, 0], square[:, 1] = x[square[:, 0].astype(int)], y[square[:, 1].astype(int)]
        square[:, 2] -= drawing.plane.heights(square) / drawing.plane.normal[2]
        panel.add_collection(
            PolyCollection([square[:, axes]], facecolor=_TABLE, edgecolor=_TABLE, label="table")
        )
    if drawing.hand is not None:
        panel.add_collection(
            PolyCollection(
                drawing.hand[..., axes], facecolor="0.2", alpha=0.12, label="hand, where it grasps"
            )
        )
    panel.plot(*drawing.rest[:, axes].T, ".", markersize=1, color="0.6", label="no object")
    for number, (words, points) in enumerate(drawing.objects.items(), start=1):
        panel.plot(*points[:, axes].T, ".", markersize=1.5, label=words)
        panel.annotate(str(number), middle(points)[axes], fontsize=14, ha="center", va="center")
    outlines = [_outline(corners[:, axes]) for corners in drawing.around]
    panel.add_collection(LineCollection(outlines, colors="0.4", linewidths=0.6, label="kept clear of"))
    if drawing.hull is not None:
        triangles = drawing.hull[:, [0, 1, 2, 0]][..., axes]
        panel.add_collection(
            LineCollection(triangles, colors="k", linewidths=0.3, label="what is planned on")
        )
    for which, axis in zip("xy", axes, strict=True):
        panel.set(**{f"{which}lim": (low[axis], high[axis]), f"{which}label": f"{'xyz'[axis]}, m"})


def _outline(points: Array) -> Array:
    """Return the convex outline (N, 2) of points, closed; of points in a line what they span."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        around = ConvexHull(points).vertices
    except QhullError:
        return points[[0, -1]]
    return points[[*around, around[0]]]


def _draw(
    axes: Any, points: Array, hull: "trimesh.Trimesh | None", true_mesh: "trimesh.Trimesh | None"
) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    drawn = [points] if len(points) else []
    if true_mesh is not None:
        axes.add_collection3d(
            Poly3DCollection(np.asarray(true_mesh.triangles), facecolor="0.45", alpha=0.35, label="true mesh")
        )
        drawn.append(np.asarray(true_mesh.vertices))
    if hull is not None:
        edges = np.asarray(hull.vertices)[np.asarray(hull.edges_unique)]
        axes.add_collection3d(
            Line3DCollection(edges, colors="tab:blue", linewidths=0.4, alpha=0.6, label="hull of the cloud")
        )
        drawn.append(np.asarray(hull.vertices))
    if len(points):
        axes.scatter(*points.T, s=2.5, c="tab:red", depthshade=False, label="segmented points")
    _frame(axes, np.concatenate(drawn) if drawn else np.zeros((1, 3)))


def _frame(axes: Any, drawn: Array) -> None:
    centre, half = middle(drawn), 0.5 * np.maximum(np.ptp(drawn, axis=0), 0.02)
    half[:2] = half[:2].max()
    for name, place, away in zip("xyz", centre, half, strict=True):
        getattr(axes, f"set_{name}lim")(place - away, place + away)
        getattr(axes, f"set_{name}label")(f"{name}, m", fontsize=8)
    axes.set_box_aspect(half, zoom=1.0)
    axes.tick_params(labelsize=6)
    axes.locator_params(nbins=4)
