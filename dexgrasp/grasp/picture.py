"""Pictures of a grasp, hand, table, hull, contacts, friction cones and forces, and of what a hand can do."""

from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.grasp import Grasp
from dexgrasp.mechanics.cones import cone_edges
from dexgrasp_env.arrays import Array, middle, unit
from dexgrasp_env.perception.picture import save
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.model import compiled_robot, posed

_COLOURS = ("#d1495b", "#2e6f95", "#3a7d44", "#8f5aa8", "#b8860b")  # of the contacts, in their order
_VIEWS = ((14, -60), (14, 120), (90, -90))  # elevation and azimuth, deg; the last from above
_HAND, _TABLE = (0.25, 0.27, 0.30, 0.22), (0.80, 0.72, 0.62, 0.55)
_AROUND = 0.045  # m that is shown around the object
_TICKS, _ZOOM = 4, 1.02
_CONE_LENGTH, _CONE_SIDES = 0.03, 24  # m
_NEWTON = 0.008  # m that a newton is drawn as
_AXIS, _HINGE = 0.06, 0.008  # m, arrows of frames and pads, and half of a joint's axis
_PALM_AXES = (("#c00000", "palm x: the way of approach"), ("#008000", "palm y"), ("#0000c0", "palm z"))


def grasp_picture(path: Path, grasp: Grasp, target: GraspTarget, title: str) -> Path:
    """Write a PNG with three views of a grasp.

    Args:
        path: file to write.
        grasp: what to draw.
        target: the object it was planned on.
        title: above the picture; the certificate's figures stand below.
    """
    from matplotlib.figure import Figure

    figure = Figure((15, 5.0))
    hand = hand_triangles(grasp.cell, grasp.q)
    box = _box(target.distance.triangles, hand)
    for k, view in enumerate(_VIEWS):
        axes = _add_axes(figure, (1, len(_VIEWS), k + 1), box, view)
        _draw(axes, grasp, target, hand, box)
    figure.legend(*axes.get_legend_handles_labels(), loc="upper left", frameon=False, fontsize=10)
    figure.suptitle(title)
    figure.text(0.5, 0.02, _caption(grasp), ha="center", fontsize=11)
    figure.subplots_adjust(left=0.01, right=0.98, bottom=0.06, top=0.97, wspace=0.1)
    return save(figure, path)


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
    from matplotlib.figure import Figure

    figure = Figure((4 * (len(postures) + len(grasps)), 4.4))
    shown = postures | {name: grasp.q for name, (grasp, _) in grasps.items()}
    for k, (name, q) in enumerate(shown.items()):
        hand = hand_triangles(cell, q)
        box = _box(hand, hand)
        axes = _add_axes(figure, (1, len(shown), k + 1), box, _VIEWS[0])
        if name in grasps:
            _draw(axes, *grasps[name], hand, box)
        else:
            _add_solid(axes, hand, (*_HAND[:3], 0.5), (0.2, 0.2, 0.2, 0.2))
        axes.set_title(name)
    figure.subplots_adjust(left=0.02, right=0.97, bottom=0.05, top=0.92, wspace=0.1)
    return save(figure, path)


def found_picture(path: Path, cell: Cell) -> Path:
    """Write a PNG of what was found of a hand: palm frame, way of approach, pads, drives and couplings over the shapes.

    Args:
        path: file to write.
        cell: whose hand it is.
    """
    from matplotlib.figure import Figure

    robot, q = cell.robot, cell.robot.home
    model, hand = compiled_robot(cell), hand_triangles(cell, q)
    data, figure, leaders = (
        posed(model, q),
        Figure((14, 7)),
        {c.joint: c.follows for c in robot.hand.couplings},
    )
    palm = data.site(robot.hand.palm)
    box = _box(hand, hand)
    for k, view in enumerate(_VIEWS[:2]):
        axes = _add_axes(figure, (1, 2, k + 1), box, view)
        _add_solid(axes, hand, (*_HAND[:3], 0.12), (0.2, 0.2, 0.2, 0.06))
        for column, (colour, what) in enumerate(_PALM_AXES):
            end = palm.xpos + _AXIS * palm.xmat.reshape(3, 3)[:, column]
            _arrow(axes, palm.xpos, end, colour, 2.5, what)
        for finger, colour in zip(robot.grasping, _COLOURS, strict=False):
            site, body = data.site(finger.tip), data.body(finger.bodies[-1])
            pad = (
                body.xmat.reshape(3, 3) @ finger.pad
                + (robot.hand.torsion > 0.0) * site.xmat.reshape(3, 3)[:, 2]
            )
            _arrow(axes, site.xpos, site.xpos + _AXIS * unit(pad), colour, 2.0, f"pad of {finger.name}")
        for name in robot.hand.joints.names:
            at, leader = data.joint(name).xanchor, leaders.get(name)
            ends = at + _HINGE * np.outer([-1.0, 1.0], data.joint(name).xaxis)
            axes.plot(
                *ends.T,
                color="k" if leader is None else "0.55",
                linewidth=2.0,
                linestyle="-" if leader is None else ":",
            )
            if leader is None:
                axes.text(*at, name, fontsize=6)
            else:
                axes.plot(
                    *np.array([at, data.joint(leader).xanchor]).T, color="0.55", linewidth=0.8, linestyle="--"
                )
    figure.legend(*axes.get_legend_handles_labels(), loc="upper left", frameon=False, fontsize=9)
    figure.suptitle(f"{robot.hand.name}: black joints are driven, dashed ones follow")
    figure.subplots_adjust(left=0.01, right=0.98, bottom=0.03, top=0.95, wspace=0.05)
    return save(figure, path)


def hand_triangles(cell: Cell, q: Array) -> Array:
    """Return the hand's collision shapes in a posture (n,) rad, triangles (N, 3, 3) m in the world frame."""
    from dexgrasp_env.scene.shapes import geom_mesh

    model = compiled_robot(cell)
    data = posed(model, q)
    of_hand = np.isin(model.geom_bodyid, [model.body(name).id for name in cell.robot.hand.bodies])
    return np.concatenate([
        geom_mesh(model, geom).triangles @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        for geom in np.flatnonzero(of_hand & (model.geom_contype > 0)).tolist()
    ])  # fmt: skip


def _draw(axes: Any, grasp: Grasp, target: GraspTarget, hand: Array, box: Array) -> None:
    from matplotlib.colors import to_rgba

    (x, y, _), (X, Y, _) = box
    _add_solid(axes, [[(x, y, 0), (X, y, 0), (X, Y, 0), (x, Y, 0)]], _TABLE, "none")
    _add_solid(axes, hand, _HAND, (0.2, 0.2, 0.2, 0.10), 0.3)
    _add_solid(axes, target.distance.triangles, (0.87, 0.66, 0.33, 0.35), (0.45, 0.40, 0.30, 0.35))
    contacts = zip(_COLOURS, grasp.fingers, grasp.contacts, grasp.normals, grasp.forces[:, :3], strict=False)
    for colour, finger, p, n, f in contacts:
        rim = p + _CONE_LENGTH * cone_edges(n[None], grasp.certificate.friction, _CONE_SIDES)[0]
        cone = np.stack([np.broadcast_to(p, rim.shape), rim, np.roll(rim, -1, axis=0)], axis=1)
        _add_solid(axes, cone, to_rgba(colour, 0.25), "none")
        axes.scatter(*p, color=colour, s=28, depthshade=False)
        _arrow(axes, p - _NEWTON * f, p, colour, 2.4, f"{finger}: {np.linalg.norm(f):.1f} N")
    weight = np.array([0, 0, _NEWTON * 9.81 * grasp.certificate.mass])
    _arrow(axes, target.centre, target.centre - weight, "k", 1.8, "weight")


def _add_solid(axes: Any, polygons: Any, face: Any, edge: Any, width: float = 0.4) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    axes.add_collection3d(Poly3DCollection(polygons, facecolor=face, edgecolor=edge, linewidth=width))


def _box(triangles: Array, hand: Array) -> Array:
    """Corners (2, 3) of what is shown: around triangles, m, from below the table where they reach there."""
    corners = triangles.reshape(-1, 3)
    half = 0.5 * np.ptp(corners, axis=0)[:2].max() + _AROUND
    box = middle(corners) + np.array([[-half], [half]])
    box[:, 2] = max(corners[:, 2].min(), 0.0) - 0.01, max(hand[..., 2].max(), corners[:, 2].max()) + 0.01
    return box


def _add_axes(figure: Any, place: tuple[int, int, int], box: Array, view: tuple[int, int]) -> Any:
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    axes, from_above = figure.add_subplot(*place, projection="3d", computed_zorder=False), view[0] == 90
    axes.view_init(*view)
    for name, limits in zip("xyz", box.T, strict=True):
        axes.set(**{f"{name}lim": limits, f"{name}label": f"{name} / cm"})
        axis = getattr(axes, f"{name}axis")
        axis.set_major_locator(MaxNLocator(_TICKS))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{100 * value:.0f}"))
    axes.set_box_aspect(box[1] - box[0], zoom=1.0 if from_above else _ZOOM)
    axes.tick_params(labelsize=8)
    if from_above:
        axes.set_proj_type("ortho")
        axes.set(zticks=[], zlabel="")
    return axes


def _arrow(axes: Any, a: Array, b: Array, colour: str, width: float, label: str) -> None:
    axes.quiver(*a, *(b - a), color=colour, linewidth=width, arrow_length_ratio=0.25, label=label)


def _caption(grasp: Grasp) -> str:
    c = grasp.certificate
    distances = ", ".join(f"{d:.2f}" for d in c.distances_cm)
    return (
        f"distances {distances} cm    closure margin {c.closure_margin:.2f}    "
        f"clearance {1000 * c.min_clearance_m:.1f} mm    "
        f"joint torque {100 * c.max_joint_torque_fraction:.0f} % of its limit    made for {1000 * c.mass:.0f} g"
    )
