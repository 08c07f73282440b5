"""A picture for people: the cloud, its hull and the true mesh overlaid."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, middle

if TYPE_CHECKING:
    import trimesh

    from dexgrasp_env.perception.detected import DetectedObject
    from dexgrasp_env.perception.scene import Scene

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


def objects_picture(path: Path, scene: "Scene", seen: "list[DetectedObject]") -> Path:
    """Draw the objects of a scene from above with their numbers, the robot to the left, and write them as PNG."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 8.0))
    axes = figure.add_subplot(xlabel="x, m", ylabel="y, m", aspect="equal")
    axes.plot(*scene.rest.points[:, :2].T, ".", markersize=2, color="0.7")
    for one, cloud in zip(seen, [c for c in (scene.target, *scene.neighbours) if len(c)], strict=True):
        axes.plot(*cloud.points[:, :2].T, ".", markersize=2)
        x, y, _ = cloud.points.mean(0)
        axes.text(x, y, f"{one.number}{'?' * one.doubtful}", fontsize=16, ha="center", va="center")
    return save(figure, path)


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
