"""Pictures of a grasp, hand, table, hull, contacts, friction cones and forces, and of what a hand can do."""

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.certificate import figures_of
from dexgrasp.grasp.grasp import Grasp
from dexgrasp.mechanics.cones import cone_edges
from dexgrasp_env.arrays import Array, middle, unit
from dexgrasp_env.perception.picture import save
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.model import compiled_robot, posed

_COLOURS = ("#d1495b", "#2e6f95", "#3a7d44", "#8f5aa8", "#b8860b")  # of the contacts, in their order
_SIDES, _ABOVE = ((14, -60), (14, 120)), (90, -90)  # elevation and azimuth, deg
_HAND, _EDGES = (0.25, 0.27, 0.30), (0.2, 0.2, 0.2)
_CAPTION = {
    "distances, cm": "{distances}",
    "closure margin": "{closure_margin:.2f}",
    "clearance, mm": "{clearance_mm:.1f}",
    "joint torque of its limit": "{max_joint_torque_fraction:.0%}",
    "made for, g": "{grams:.0f}",
}


class _Panel(NamedTuple):
    """One view of something: drawn within a box (2, 3) m, seen from an elevation and azimuth, deg."""

    box: Array
    view: tuple[int, int]
    draw: Callable[[Any], None]
    title: str = ""


def grasp_picture(path: Path, grasp: Grasp, target: GraspTarget, title: str) -> Path:
    """Write a PNG with three views of a grasp.

    Args:
        path: file to write.
        grasp: what to draw.
        target: the object it was planned on.
        title: above the picture; the certificate's figures stand below.
    """
    hand = hand_triangles(grasp.cell, grasp.q)
    box = _box(target.distance.triangles, hand)
    draw = partial(_draw_grasp, grasp, target, hand, box)
    figures = figures_of(grasp.certificate.as_json(), _CAPTION)
    caption = "    ".join(f"{name}: {value}" for name, value in figures.items())
    return _write(path, [_Panel(box, view, draw) for view in (*_SIDES, _ABOVE)], title, caption)


def hand_picture(
    path: Path, cell: Cell, postures: dict[str, Array], grasps: dict[str, tuple[Grasp, GraspTarget]]
) -> Path:
    """Write a PNG of a hand in postures and in grasps, side by side.

    Args:
        path: file to write.
        cell: whose hand it is.
        postures: (n,) rad, by what they are called.
        grasps: with what they hold, by its name.
    """
    panels = []
    for name, q in (postures | {name: grasp.q for name, (grasp, _) in grasps.items()}).items():
        hand = hand_triangles(cell, q)
        box = _box(hand, hand)
        draw = partial(_add_solid, polygons=hand, face=(*_HAND, 0.5), edge=(*_EDGES, 0.2))
        if name in grasps:
            draw = partial(_draw_grasp, *grasps[name], hand, box)
        panels.append(_Panel(box, _SIDES[0], draw, name))
    return _write(path, panels)


def found_picture(path: Path, cell: Cell) -> Path:
    """Write a PNG of what was found of a hand: palm frame, way of approach, pads, drives and couplings over the shapes.

    Args:
        path: file to write.
        cell: whose hand it is.
    """
    hand = hand_triangles(cell, cell.robot.home)
    draw = partial(_draw_found, cell, hand)
    title = f"{cell.robot.hand.name}: black joints are driven, dashed ones follow; arrows are 6 cm"
    box = np.array([hand.min(axis=(0, 1)), hand.max(axis=(0, 1))])
    return _write(path, [_Panel(box, view, draw) for view in _SIDES], title, left=0.15)


def hand_triangles(cell: Cell, q: Array) -> Array:
    """Return the hand's collision shapes in a posture (n,) rad, triangles (N, 3, 3) m in the world frame."""
    data = posed(compiled_robot(cell), q)
    return np.concatenate([
        triangles @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        for geom, triangles in _shapes(cell).items()
    ])  # fmt: skip


@lru_cache(maxsize=2)  # a plan is drawn twice
def _shapes(cell: Cell) -> dict[int, Array]:
    """Return the triangles (N, 3, 3) m, in their own frames, of the geoms of the hand that collide."""
    from dexgrasp_env.scene.geom_mesh import geom_mesh

    model = compiled_robot(cell)
    of_hand = np.isin(model.geom_bodyid, [model.body(name).id for name in cell.robot.hand.bodies])
    geoms = np.flatnonzero(of_hand & (model.geom_contype > 0)).tolist()
    return {geom: geom_mesh(model, geom).triangles for geom in geoms}


def _draw_grasp(grasp: Grasp, target: GraspTarget, hand: Array, box: Array, axes: Any) -> None:
    newton, cone_length = 0.008, 0.03  # m that a newton, and a cone, are drawn as
    (x, y, _), (X, Y, _) = box
    _add_solid(axes, [[(x, y, 0), (X, y, 0), (X, Y, 0), (x, Y, 0)]], (0.80, 0.72, 0.62, 0.55), "none")
    _add_solid(axes, hand, (*_HAND, 0.22), (*_EDGES, 0.1))
    _add_solid(axes, target.distance.triangles, (0.87, 0.66, 0.33, 0.35), (0.45, 0.40, 0.30, 0.35))
    contacts = zip(_COLOURS, grasp.fingers, grasp.contacts, grasp.normals, grasp.forces[:, :3], strict=False)
    for colour, finger, p, n, f in contacts:
        rim = p + cone_length * cone_edges(n[None], grasp.certificate.friction, 24)[0]
        cone = np.stack([np.broadcast_to(p, rim.shape), rim, np.roll(rim, -1, axis=0)], axis=1)
        _add_solid(axes, cone, (colour, 0.25), "none")
        axes.scatter(*p, color=colour, s=28, depthshade=False)
        _arrow(axes, p - newton * f, p, colour, f"{finger}: {np.linalg.norm(f):.1f} N")
    weight = np.array([0, 0, newton * 9.81 * grasp.certificate.mass])
    _arrow(axes, target.centre, target.centre - weight, "k", "weight")


def _draw_found(cell: Cell, hand: Array, axes: Any) -> None:
    robot, arrow, hinge = cell.robot, 0.06, 0.008  # m, arrows of frames and pads, and half of a joint's axis
    data = posed(compiled_robot(cell), robot.home)
    leaders = {own.joint: own.follows for own in robot.hand.couplings}
    palm = data.site(robot.hand.palm)
    axes.set_axis_off()
    axes.set_box_aspect(np.ptp(hand, axis=(0, 1)), zoom=1.15)
    words = ("palm x: the way of approach", "palm y", "palm z")
    _add_solid(axes, hand, (*_HAND, 0.12), (*_EDGES, 0.06))
    for colour, what, way in zip(
        ("#c00000", "#008000", "#0000c0"), words, palm.xmat.reshape(3, 3).T, strict=True
    ):
        _arrow(axes, palm.xpos, palm.xpos + arrow * way, colour, what)
    for finger, colour in zip(robot.grasping, _COLOURS, strict=False):
        site, body = data.site(finger.tip), data.body(finger.bodies[-1])
        pad = body.xmat.reshape(3, 3) @ finger.pad
        if robot.hand.torsion > 0.0:  # a jaw closes between its pad and its end
            pad = unit(pad + site.xmat.reshape(3, 3)[:, 2])
        _arrow(axes, site.xpos, site.xpos + arrow * pad, colour, f"pad of {finger.name}")
    for k, name in enumerate(robot.hand.joints.names, 1):
        at, leader = data.joint(name).xanchor, leaders.get(name)
        colour, label = ("k", f"{k}: {name}") if leader is None else ("0.55", None)
        ends = at + hinge * np.outer([-1.0, 1.0], data.joint(name).xaxis)
        axes.plot(*ends.T, color=colour, linewidth=2.0, label=label)
        if leader is None:
            axes.text(*ends[1], str(k), fontsize=9)
        else:
            axes.plot(*np.array([at, data.joint(leader).xanchor]).T, color=colour, linestyle="--")


def _box(triangles: Array, hand: Array) -> Array:
    """Corners (2, 3) of what is shown: around triangles, m, from below the table where they reach there."""
    corners, around = triangles.reshape(-1, 3), 0.045  # m
    half = 0.5 * np.ptp(corners, axis=0)[:2].max() + around
    box = middle(corners) + np.array([[-half], [half]])
    box[:, 2] = max(corners[:, 2].min(), 0.0) - 0.01, max(hand[..., 2].max(), corners[:, 2].max()) + 0.01
    return box


def _add_solid(axes: Any, polygons: Any, face: Any, edge: Any) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    axes.add_collection3d(Poly3DCollection(polygons, facecolor=face, edgecolor=edge, linewidth=0.4))


def _arrow(axes: Any, a: Array, b: Array, colour: str, label: str) -> None:
    axes.quiver(*a, *(b - a), color=colour, linewidth=2.0, arrow_length_ratio=0.25, label=label)


def _write(
    path: Path, panels: Sequence[_Panel], title: str = "", caption: str = "", left: float = 0.02
) -> Path:
    """Write panels side by side as PNG; with a title there is a legend, at the left, of what the last one shows."""
    from matplotlib.figure import Figure

    figure = Figure((5.0 * len(panels), 5.0))
    for k, panel in enumerate(panels):
        axes = figure.add_subplot(1, len(panels), k + 1, projection="3d", computed_zorder=False)
        axes.view_init(*panel.view)
        x, y, z = panel.box.T
        axes.set(xlim=x, ylim=y, zlim=z, xlabel="x / m", ylabel="y / m", zlabel="z / m", title=panel.title)
        axes.set_box_aspect(panel.box[1] - panel.box[0])
        axes.locator_params(nbins=5)
        axes.tick_params(labelsize=7)
        if panel.view == _ABOVE:
            axes.set_proj_type("ortho")
            axes.set(zticks=[], zlabel="")
        panel.draw(axes)
    if title:
        figure.legend(*axes.get_legend_handles_labels(), loc="upper left", frameon=False, fontsize=9)
    figure.suptitle(title, x=(left + 1.0) / 2)
    figure.text(0.5, 0.02, caption, ha="center", fontsize=11)
    figure.subplots_adjust(left=left, right=0.95, bottom=0.06, top=0.93, wspace=0.1)
    return save(figure, path)
