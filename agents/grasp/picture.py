"""A picture of a grasp: hull, contacts, normals, friction cones and forces."""

from pathlib import Path
from typing import Any

import numpy as np

from agents.grasp.grasp import Grasp
from agents.grasp.target import GraspTarget
from agents.physics.cones import tangent_basis
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.names import GRASP_FINGERS

_COLOURS = ("#d1495b", "#2e6f95", "#3a7d44")  # thumb, index, middle
_VIEWS = ((22, -60), (22, 120), (88, -90))
_CONE_LENGTH, _CONE_SIDES = 0.03, 24  # m
_NEWTON = 0.008  # m that a newton is drawn as


def grasp_picture(path: Path, grasp: Grasp, target: GraspTarget, title: str = "") -> Path:
    """Write a PNG with three views of a grasp.

    Args:
        path: file to write.
        grasp: what to draw.
        target: the object it was planned on.
        title: above the picture; the certificate's figures stand below.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14, 5.4))
    FigureCanvasAgg(figure)
    for k, (elevation, azimuth) in enumerate(_VIEWS):
        axes: Any = figure.add_subplot(1, 3, k + 1, projection="3d", computed_zorder=False)
        _draw(axes, grasp, target)
        axes.view_init(elevation, azimuth)
    figure.legend(*axes.get_legend_handles_labels(), loc="upper right", frameon=False, fontsize=9)
    figure.suptitle(title)
    figure.text(0.5, 0.02, _caption(grasp), ha="center", fontsize=10)
    figure.subplots_adjust(left=0.0, right=0.98, bottom=0.08, top=0.92, wspace=0.02)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    return path


def _draw(axes: Any, grasp: Grasp, target: GraspTarget) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    triangles = target.distance.triangles
    axes.add_collection3d(
        Poly3DCollection(
            triangles, facecolor=(0.75, 0.75, 0.72, 0.35), edgecolor=(0.45, 0.45, 0.45, 0.35), linewidth=0.4
        )
    )
    for i, finger in enumerate(GRASP_FINGERS):
        p, n, f = grasp.contacts[i], grasp.normals[i], grasp.forces[i]
        axes.add_collection3d(
            Poly3DCollection(
                _cone(p, n, grasp.certificate.friction), facecolor=_COLOURS[i], alpha=0.18, linewidth=0
            )
        )
        axes.scatter(*p, color=_COLOURS[i], s=28, depthshade=False)
        _arrow(axes, p, p + 0.025 * n, "0.4", 1.0)
        _arrow(axes, p - _NEWTON * f, p, _COLOURS[i], 2.4, f"{finger}: {np.linalg.norm(f):.1f} N")
    _arrow(
        axes,
        target.centre,
        target.centre - np.array([0, 0, _NEWTON * 9.81 * grasp.certificate.mass]),
        "k",
        1.8,
        "weight",
    )
    low, high = triangles.reshape(-1, 3).min(0), triangles.reshape(-1, 3).max(0)
    middle, half = 0.5 * (low + high), 0.55 * float((high - low).max()) + 0.02
    for setter, m in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), middle, strict=True):
        setter(m - half, m + half)
    axes.set_box_aspect((1, 1, 1))
    axes.set_xlabel("x / m", fontsize=8)
    axes.set_ylabel("y / m", fontsize=8)
    axes.tick_params(labelsize=6)


def _arrow(axes: Any, a: Array, b: Array, colour: str, width: float, label: str | None = None) -> None:
    d = b - a
    axes.quiver(*a, *d, color=colour, linewidth=width, arrow_length_ratio=0.25, label=label)


def _cone(p: Array, n: Array, friction: float) -> Array:
    """Triangles of the friction cone into the object."""
    t1, t2 = (t[0] for t in tangent_basis(n[None]))
    angle = np.linspace(0.0, 2.0 * np.pi, _CONE_SIDES + 1)
    rim = (
        p
        - _CONE_LENGTH * n
        + _CONE_LENGTH * friction * (np.cos(angle)[:, None] * t1 + np.sin(angle)[:, None] * t2)
    )
    return np.stack([np.broadcast_to(p, rim[:-1].shape), rim[:-1], rim[1:]], axis=1)


def _caption(grasp: Grasp) -> str:
    c = grasp.certificate
    distances = ", ".join(f"{d:.2f}" for d in c.distances_cm)
    return (
        f"distances {distances} cm    closure margin {c.closure_margin:.2f}    "
        f"clearance {1000 * c.min_clearance_m:.1f} mm    "
        f"joint torque {100 * c.max_joint_torque_fraction:.0f} % of its limit    made for {1000 * c.mass:.0f} g"
    )
