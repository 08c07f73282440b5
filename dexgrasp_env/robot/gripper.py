"""Jaws of a gripper's description: where two fingers close, which faces are their pads, how large they are."""

from typing import NamedTuple

import numpy as np

from dexgrasp_env.arrays import Array, middle
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import rigid
from dexgrasp_env.robot.hulls import cut
from dexgrasp_env.robot.part import Part

_PAD = (0.006, 0.014)  # m: radii of the spheres that pads are taken for


class Jaws(NamedTuple):
    """Two jaws in the world of the file; the first is on the side of the palm frame's y.

    A tip's frame has its origin a radius behind the pad's face; x out of the pad and z out of the tip are each at 45
    degrees to the way the jaw closes.
    """

    ends: tuple[int, int]  # last bodies
    palm: Array  # (4, 4): x the way of approach, y the way the second jaw closes
    tips: tuple[Array, Array]  # (4, 4)
    radius: float  # m
    torsion: float  # m
    stroke: float  # m between the pads, opened


def find_jaws(part: Part, palm: int, ends: list[int], opened: Array, closed: Array) -> Jaws:
    """Return the jaws whose last bodies are `ends`; `part.data` is left half closed.

    Args:
        part: the description.
        palm: body that bears the jaws.
        ends: last bodies of two jaws.
        opened, closed: (n,) places of all joints, rad or m.

    Raises:
        InputError: where the two do not move against each other.
    """
    part.place(opened)
    at_open = [part.points(body).mean(0) for body in ends]
    part.place(closed)
    moved = [a - part.points(body).mean(0) for a, body in zip(at_open, ends, strict=True)]
    y, axes = moved[0] - moved[1], part.pose(palm)[:3, :3]
    if np.linalg.norm(y) < 0.005:
        raise InputError(f"{part.path}: its two fingers do not move against each other")
    part.place(0.5 * (opened + closed))
    own = [part.points(body) for body in ends]
    y = _snapped(y, axes)
    if (middle(own[0]) - middle(own[1])) @ y < 0:
        ends, own = ends[::-1], own[::-1]
    x = middle(np.concatenate(own)) - middle(part.outline(palm))
    x = _snapped(x - x @ y * y, axes)
    pads = [_pad(part, body, way, x) for body, way in zip(ends, (-y, y), strict=True)]
    radius = round(float(np.clip(min(size for _, size in pads), *_PAD)), 4)
    tips = [_tip_frame(centre, way, x, radius) for (centre, _), way in zip(pads, (-y, y), strict=True)]
    origin = middle(np.array([T[:3, 3] for T in tips]))
    front = part.outline(palm) @ x
    origin += (min(front.max(), origin @ x - 0.025) - origin @ x) * x  # pads are 25 mm before it at least
    stroke = abs((at_open[0] - at_open[1]) @ y) - abs((own[0].mean(0) - own[1].mean(0)) @ y)
    stroke += float((pads[0][0] - pads[1][0]) @ y)
    # Torsional over sliding friction of a flat patch is 2/3 of its radius: taken with a reserve.
    torsion = round(0.6 * radius, 4)
    T_palm = rigid(np.stack([x, y, np.cross(x, y)], axis=1), origin)
    return Jaws((ends[0], ends[1]), T_palm, (tips[0], tips[1]), radius, torsion, stroke)


def _snapped(way: Array, axes: Array) -> Array:
    """Return a direction (3,) as a unit vector; an axis (columns of `axes`) that it is close to instead."""
    way = way / np.linalg.norm(way)
    along = way @ axes
    k = int(np.argmax(np.abs(along)))
    return np.asarray(np.sign(along[k]) * axes[:, k] if abs(along[k]) > 0.97 else way)


def _pad(part: Part, body: int, way: Array, x: Array) -> tuple[Array, float]:
    """Return the middle (3,) m of the face with which a jaw closes along `way`, near its end, and its half size."""
    R = np.stack([way, np.cross(x, way), x], axis=1)
    shapes = [points @ R for points in part.shapes(body)]
    end = max(points[:, 2].max() for points in shapes)
    # The pad is sought in the last 35 mm, or the last half of a shorter jaw.
    end_of = min(0.035, 0.5 * (end - min(points[:, 2].min() for points in shapes)))
    near = np.concatenate(
        [
            cut(points, end - end_of)[0] if points[:, 2].min() < end - end_of else points
            for points in shapes
            if points[:, 2].max() > end - end_of
        ]
    )
    face = near[near[:, 0] > near[:, 0].max() - 0.001]  # m of depth
    low, high = face.min(0), face.max(0)
    size = 0.5 * min(high[1] - low[1], high[2] - low[2], np.ptp(near[:, 0]))
    centre = 0.5 * (low + high)
    centre[0] = high[0]
    centre[2] = min(centre[2], end - min(max(size, _PAD[0]), _PAD[1]))
    return R @ centre, size


def _tip_frame(pad: Array, way: Array, x: Array, radius: float) -> Array:
    z, out = (way + x) / np.sqrt(2.0), (way - x) / np.sqrt(2.0)
    return rigid(np.stack([out, np.cross(z, out), z], axis=1), pad - radius * way)
