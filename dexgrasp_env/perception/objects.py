"""What stands on a table told apart: objects, each by itself, and what belongs to none."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator

from dexgrasp_env.arrays import Array
from dexgrasp_env.perception.cloud import Cloud, downsample, smooth
from dexgrasp_env.perception.parting import LEAST_EXTENT, LEAST_POINTS, MOST_EXTENT, Parting
from dexgrasp_env.perception.plane import Plane
from dexgrasp_env.perception.scene import ObjectCloud, Scene


def objects_of(cloud: Cloud, parting: Parting) -> list[int]:
    """Return the numbers of those things on the table that are objects, the largest first."""
    counts = np.bincount(parting.labels)
    sides = {
        int(k): extents(cloud.points[parting.labels == k]).max()
        for k in np.flatnonzero(counts >= LEAST_POINTS)
    }
    found = [k for k, side in sides.items() if LEAST_EXTENT <= side <= MOST_EXTENT]
    return sorted(found, key=lambda k: -counts[k])


def extents(points: Array) -> Array:
    """Return the sides (3,) m of the box around points (N, 3)."""
    return np.ptp(points, axis=0) if len(points) else np.zeros(3)


def object_cloud(
    cloud: Cloud,
    plane: Plane | None,
    count: int,
    doubtful: bool = False,
    rng: Generator | None = None,
) -> ObjectCloud:
    """Return a cloud as `count` smoothed points at most, in single precision, as observations hold them.

    Without a generator the same points are drawn each time.
    """
    if not len(cloud):
        return ObjectCloud()
    rng = rng or np.random.default_rng(len(cloud))
    chosen = cloud.select(downsample(cloud.points, count, rng))
    points, normals = smooth(cloud, chosen, 0.0 if plane is None else plane.rms)
    return ObjectCloud(points.astype(np.float32), normals.astype(np.float32), chosen.pixel, doubtful)


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
        doubtful: whether it may be two, or a part of the next.
    """

    number: int
    place: Array
    extents: Array
    next: float
    apart: float
    doubtful: bool = False

    def __str__(self) -> str:
        return in_words(self.place, self.extents)


def in_words(place: Array, sides: Array) -> str:
    """Return for people where something is, (3,) m, and how large, (3,) m."""
    size = " x ".join(f"{100 * side:.0f}" for side in sides)
    return f"{size} cm at ({', '.join(f'{x:.2f}' for x in place)})"


def listed(scene: Scene, base: Array) -> list[Seen]:
    """Return the objects that a scene shows, `base` (3,) m being where the robot's base is in the world."""
    shown = [one for one in (scene.target, *scene.neighbours) if len(one)]
    clouds: Sequence[Array] = [one.points for one in shown]
    gaps = np.array([[_gap(a, b) if a is not b else np.inf for b in clouds] for a in clouds])
    middles = [0.5 * (points.min(0) + points.max(0)) - base for points in clouds]
    return [
        Seen(k + 1, middles[k], extents(points), float(gaps[k].min()), float(gaps[0, k]), shown[k].doubtful)
        for k, points in enumerate(clouds)
    ]


def _gap(a: Array, b: Array) -> float:
    from scipy.spatial import cKDTree

    return float(cKDTree(a).query(b)[0].min())
