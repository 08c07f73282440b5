"""What stands on a table told apart: objects, each by itself, and what belongs to none."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.perception.cloud import Cloud, clusters, downsample
from dexgrasp_env.perception.normals import smooth
from dexgrasp_env.perception.plane import Plane
from dexgrasp_env.perception.scene import ObjectCloud, Scene

LEAST_POINTS, LEAST_EXTENT = 50, 0.02
"""Points, and m of the longest side of a box around them, from which on a cluster is an object."""
_LINKS, _SPACINGS = (0.008, 0.015), 4.0  # m, least and most of a link; spacings of the points that it is long
_JUDGED = 2000  # points whose spacing is looked at
MOST_EXTENT = 0.35
"""m of the longest side: what is longer is a wall, a bin, furniture."""


def link_of(cloud: Cloud) -> float:
    """Return the steps, m, that link the points of an object: as short as they lie close, so that gaps are gaps."""
    if len(cloud) < 2:
        return _LINKS[1]
    from scipy.spatial import cKDTree

    few = cloud.points[:: max(1, len(cloud) // _JUDGED)]
    spacing = float(np.median(cKDTree(cloud.points).query(few, k=2)[0][:, 1]))
    return float(np.clip(_SPACINGS * spacing, *_LINKS))


def told_apart(cloud: Cloud, link: float) -> tuple[list[Cloud], Cloud]:
    """Return the objects in a cloud that stands on the table, the largest first, and what belongs to none.

    Args:
        cloud: without table and robot.
        link: m, the points of an object are linked by steps of at most this.
    """
    labels = clusters(cloud, link)
    found = [cloud.select(labels == k) for k in np.flatnonzero(np.bincount(labels) >= LEAST_POINTS)]
    found = [one for one in found if LEAST_EXTENT <= extents(one.points).max() <= MOST_EXTENT]
    taken = (
        np.isin(cloud.pixel, np.concatenate([one.pixel for one in found]))
        if found
        else np.zeros(len(cloud), bool)
    )
    return sorted(found, key=len, reverse=True), cloud.select(~taken)


def extents(points: Array) -> Array:
    """Return the sides (3,) m of the box around points (N, 3)."""
    return np.ptp(points, axis=0) if len(points) else np.zeros(3)


def object_cloud(cloud: Cloud, plane: Plane | None, radius: float, count: int) -> ObjectCloud:
    """Return a cloud as `count` smoothed points at most, the same ones each time, in single precision."""
    if not len(cloud):
        return ObjectCloud()
    chosen = cloud.select(downsample(cloud.points, count, np.random.default_rng(len(cloud))))
    points, normals = smooth(cloud, chosen, 0.0 if plane is None else plane.rms, radius)
    return ObjectCloud(points.astype(np.float32), normals.astype(np.float32), chosen.pixel)


def seen_from_outside(cloud: Cloud) -> Cloud:
    """Return it with views from its middle outwards: a merged cloud does not say who saw a point."""
    out = cloud.points - 0.5 * (cloud.points.min(0) + cloud.points.max(0))
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    return replace(cloud, views=out)


@dataclass(frozen=True, eq=False)
class Seen:
    """An object on the table, for people who point at one.

    Attributes:
        number: from 1 on; the one that is meant comes first.
        place: (3,) m, the middle of the box around it, in the frame of the robot's base.
        extents: (3,) m, the sides of that box.
        next: m to the nearest of the others; infinity where there is none.
        apart: m to the one that comes first.
    """

    number: int
    place: Array
    extents: Array
    next: float
    apart: float

    def __str__(self) -> str:
        size = " x ".join(f"{100 * side:.0f}" for side in self.extents)
        return f"{size} cm at ({', '.join(f'{x:.2f}' for x in self.place)})"


def listed(scene: Scene, base: Array) -> list[Seen]:
    """Return the objects that a scene shows, `base` (3,) m being where the robot's base is in the world."""
    clouds: Sequence[Array] = [one.points for one in (scene.target, *scene.neighbours) if len(one)]
    gaps = np.array([[_gap(a, b) if a is not b else np.inf for b in clouds] for a in clouds])
    middles = [0.5 * (points.min(0) + points.max(0)) - base for points in clouds]
    return [
        Seen(k + 1, middles[k], extents(points), float(gaps[k].min()), float(gaps[0, k]))
        for k, points in enumerate(clouds)
    ]


def _gap(a: Array, b: Array) -> float:
    from scipy.spatial import cKDTree

    return float(cKDTree(a).query(b)[0].min())
