"""What stands on a table told apart: objects, each by itself, and what belongs to none."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.cloud import Cloud, clusters, downsample
from dexgrasp_env.perception.normals import smooth
from dexgrasp_env.perception.plane import Plane
from dexgrasp_env.perception.scene import ObjectCloud

LEAST_POINTS, LEAST_EXTENT = 50, 0.02
"""Points, and m of the longest side of a box around them, from which on a cluster is an object."""
MOST_EXTENT = 0.35
"""m of the longest side: what is longer is a wall, a bin, furniture."""


@dataclass(frozen=True, eq=False)
class Pointing:
    """Which object is meant; with nothing said, the only one.

    Attributes:
        near: (3,) m, a point near it.
        box: (2, 3) m, lowest and highest corner of a box around it.
        mask: one bool for each row or pixel that the cloud was made from: where it is seen.
    """

    near: Array | None = None
    box: Array | None = None
    mask: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        if sum(value is not None for value in (self.near, self.box, self.mask)) > 1:
            raise InputError("point at the object in one way: near it, by a box, by a mask or by a pixel")
        if self.box is not None and not (self.box[0] < self.box[1]).all():
            raise InputError(
                "the box is empty: valid is X0 Y0 Z0 X1 Y1 Z1 with each of the first below its second"
            )

    def moved(self, by: Array) -> "Pointing":
        """Return it in a frame in which points lie `by` (3,) m elsewhere."""
        near, box = (None if place is None else place + by for place in (self.near, self.box))
        return replace(self, near=near, box=box)

    def marks(self, cloud: Cloud) -> NDArray[np.bool_] | None:
        """Return which points of a cloud are marked by box or mask (M,); None where neither is given.

        Raises:
            InputError: for a mask of another shape than the cloud's images or rows.
        """
        if self.mask is not None:
            rows = " x ".join(map(str, cloud.shape))
            if np.size(self.mask) != np.prod(cloud.shape, dtype=int):
                raise InputError(
                    f"the mask has shape {np.shape(self.mask)}: valid is one value each of {rows}"
                )
            return np.asarray(self.mask, dtype=bool).ravel()[cloud.pixel]
        if self.box is not None:
            return ((cloud.points >= self.box[0]) & (cloud.points <= self.box[1])).all(axis=1)
        return None


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
