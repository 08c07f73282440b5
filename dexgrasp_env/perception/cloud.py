"""Depth images to points in the world frame, fewer of them, and noise averaged out over all views."""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, Fields, Index, Mask, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.camera import Camera

MIN_POINTS = 40
"""Fewer raw points are no object, unless they are high above the table's noise."""
WORKSPACE_LOW, WORKSPACE_HIGH = (0.28, -0.40, -0.03), (0.78, 0.40, 0.30)
"""Corners, m, of the box in which objects are looked for."""
_MOST_POINTS = 6_000_000  # of 250 bytes each until they are thinned
_POOL = 3  # candidates to a chosen point, at most: bounds the cost of downsampling


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points and where each comes from; all arrays have M rows.

    Attributes:
        points: (M, 3) m, world frame.
        views: (M, 3) unit vectors from the points to the cameras that saw them.
        depth: (M,) m along the optical axis.
        camera: (M,) index of the camera.
        pixel: (M,) index into the flattened (cameras, H, W) images, or of the row of a file.
        shape: of what the pixels count: a mask of it says which points are meant; empty where nobody knows.
    """

    points: Array
    views: Array
    depth: Array
    camera: NDArray[np.int32]
    pixel: NDArray[np.int32]
    shape: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.points)

    def select(self, keep: NDArray[Any]) -> "Cloud":
        """Return the rows of a mask or of indices."""
        rows = np.flatnonzero(keep) if keep.dtype == bool else keep  # by number, three times as fast
        return replace(self, **{name: getattr(self, name).take(rows, axis=0) for name in _ROWS})

    def moved(self, points: Array) -> "Cloud":
        """Return the cloud with other positions."""
        return replace(self, points=points)

    def eye(self) -> Array:
        """Return where the only camera was (3,) m: nearest to all its rays."""
        across = np.eye(3) - self.views[:, :, None] * self.views[:, None]
        return np.linalg.lstsq(across.sum(0), (across @ self.points[:, :, None]).sum(0)[:, 0], rcond=None)[0]

    @classmethod
    def join(cls, clouds: list["Cloud"]) -> "Cloud":
        """Return all rows of several clouds of the same images."""
        rows: Fields = {name: np.concatenate([getattr(c, name) for c in clouds]) for name in _ROWS}
        return replace(clouds[0], **rows)


_ROWS = tuple(f.name for f in fields(Cloud) if f.name != "shape")


def check_count(points: int, source: str) -> None:
    """Raise `InputError` where a cloud has too many points."""
    if points > _MOST_POINTS:
        raise InputError(f"{source} has {points:,} points, more than {_MOST_POINTS:,}: keep one in each 2 mm")


def is_valid(depth: NDArray[Any]) -> Mask:
    """Return where a depth image holds a measurement: finite and positive."""
    with np.errstate(invalid="ignore"):
        return np.isfinite(depth) & (depth > 0)


def deproject(depth: NDArray[Any], camera: Camera) -> Array:
    """Return the organised cloud of one depth image.

    Args:
        depth: (H, W) m along the optical axis; NaN, inf and values <= 0 are no measurement.
        camera: pose and intrinsics as believed.

    Returns:
        (H, W, 3) m in the world frame, NaN where there is no measurement.
    """
    z = np.where(is_valid(depth), depth, np.nan).astype(float)
    return (camera.intrinsics.directions() * z[..., None]) @ camera.rotation.T + camera.position


def gather(depths: NDArray[Any], cameras: tuple[Camera, ...]) -> Cloud:
    """Return the valid points of all images, (cameras, H, W), as one cloud."""
    clouds = []
    for k, (depth, camera) in enumerate(zip(depths, cameras, strict=True)):
        index = np.flatnonzero(is_valid(depth))
        points = deproject(depth, camera).reshape(-1, 3)
        points = points if len(index) == len(points) else points[index]
        views = camera.position - points
        views /= np.sqrt(dot(views, views))[:, None]
        tags = np.full(len(index), k, np.int32), (index + k * depth.size).astype(np.int32)
        clouds.append(Cloud(points, views, depth.ravel()[index].astype(float), *tags, np.shape(depths)))
    return Cloud.join(clouds)


def crop(cloud: Cloud, low: Iterable[float], high: Iterable[float]) -> Cloud:
    """Return the points inside the axis-aligned box from `low` to `high`, (3,) m each, world frame."""
    return cloud.select(inside(cloud.points, low, high))


def inside(points: Array, low: Iterable[float], high: Iterable[float]) -> Mask:
    """Return which points (M, n) are in the axis-aligned box from `low` to `high`, (n,) each (M,)."""
    axes = zip(points.T, low, high, strict=True)  # one by one: ten times as fast as all at once
    return np.logical_and.reduce([(x >= least) & (x <= most) for x, least, most in axes])


def remove_flying(depths: NDArray[Any]) -> Single:
    """Return depth images without pixels that hang in the air between two surfaces.

    A pixel needs three of the eight around it within 15 mm of its depth.

    Args:
        depths: (cameras, H, W) m.

    Returns:
        (cameras, H, W) m, inf where removed or invalid.
    """
    z = np.where(is_valid(depths), depths, np.inf).astype(np.float32)
    padded = np.pad(z, ((0, 0), (1, 1), (1, 1)), constant_values=np.inf)
    support = np.zeros(z.shape, np.int8)
    h, w = z.shape[1:]
    with np.errstate(invalid="ignore"):
        for dv in range(3):
            for du in range(3):
                support += np.abs(padded[:, dv : dv + h, du : du + w] - z) < 0.015
    return np.where(support > 3, z, np.float32(np.inf))  # a pixel supports itself


def remove_outliers(cloud: Cloud, radius: float = 0.012, least: int = 4) -> Cloud:
    """Return the points with at least `least` others within `radius` metres (Open3D's radius filter)."""
    if len(cloud) <= least:
        return cloud.select(np.zeros(len(cloud), bool))
    from dexgrasp_env.perception.kernels import has_near

    points = np.ascontiguousarray(cloud.points)
    return cloud.select(has_near(points, points, radius, least + 1))


def downsample(points: Array, count: int, rng: Generator) -> Index:
    """Return the indices of an even subset: farthest point sampling in a random pool of `3 * count` points.

    Args:
        points: (M, 3) m.
        count: how many are wanted.
        rng: draws the pool and the first point.

    Returns:
        (min(M, count),) indices without repetition; all of them, in order, when there are no more than
        wanted.
    """
    candidates = np.arange(len(points))
    if len(points) <= count:
        return candidates
    if len(points) > _POOL * count:
        candidates = np.sort(rng.choice(len(points), _POOL * count, replace=False))
    from dexgrasp_env.perception.kernels import farthest_points

    first = int(rng.integers(len(candidates)))
    return candidates[farthest_points(np.ascontiguousarray(points[candidates]), count, first)]


def cells_of(points: Array, side: float) -> Index:
    """Return the number of the cell, `side` m wide, that each of points (M, n) lies in; they sort as cells do."""
    if not len(points):
        return np.zeros(0, np.int64)
    cells = np.floor(np.ascontiguousarray(points.T) / side).astype(np.int64)  # an axis a row, as above
    cells -= cells.min(1, keepdims=True)
    return np.ravel_multi_index(tuple(cells), tuple(cells.max(1) + 1))


def means_of(which: Index, rows: Array) -> Array:
    """Return the mean (K, n) of the rows (M, n) of each number (M,)."""
    sums = np.stack([np.bincount(which, column) for column in rows.T], axis=1)
    return sums / np.maximum(np.bincount(which), 1)[:, None]


def dot(rows: Array, others: Array) -> Array:
    """Return the products (M,) of rows (M, n) and others, in a quarter of the time of their products' sums."""
    return np.einsum("ij,ij->i", rows, others)


def thinned(points: Array, side: float) -> Index:
    """Return the indices, in order, of the first of points (M, n) in each cell, `side` m wide."""
    return np.sort(np.unique(cells_of(points, side), return_index=True)[1])


def pad(rows: NDArray[Any], count: int) -> NDArray[Any]:
    """Return `rows` (M, ...) as (count, ...), zeros after the last."""
    padded = np.zeros((count, *rows.shape[1:]), rows.dtype)
    padded[: len(rows)] = rows[:count]
    return padded


def smooth(cloud: Cloud, queries: Cloud, noise: float, radius: float = 0.010) -> tuple[Array, Array]:
    """Project points onto local planes of the fused cloud, one step of moving least squares.

    Points seen from near weigh more, as 1 / depth^4: noise grows with depth^2. Nothing is moved along the
    surface, nor by more than three times the noise, so that edges keep their place; without noise nothing
    moves (Alexa et al. 2003).

    Args:
        cloud: the fused points.
        queries: the points to move.
        noise: RMS noise along the rays, metres, as the table shows it.
        radius: of the neighbourhood, metres.

    Returns:
        Points (Q, 3) m and unit normals (Q, 3) towards the cameras.
    """
    from dexgrasp_env.perception.kernels import local_planes

    points, every = np.ascontiguousarray(queries.points), np.ascontiguousarray(cloud.points)
    centres, normals, residuals = local_planes(points, every, cloud.depth**-4.0, radius, 8)
    normals = np.where(dot(normals, queries.views)[:, None] < 0, -normals, normals)
    normals = np.where(dot(normals, normals)[:, None] < 0.5, queries.views, normals)
    offset = dot(queries.points - centres, normals)
    # Where the spread across the plane is more than noise, the surface is bent: trust the point more.
    bent = np.maximum(residuals**2 - noise**2, 0.0)
    share = noise**2 / np.maximum(noise**2 + bent, 1e-18)
    shift = np.clip(share * offset, -3.0 * noise, 3.0 * noise)
    return queries.points - shift[:, None] * normals, normals
