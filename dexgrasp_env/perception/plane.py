"""The table plane: found in the cloud and removed from it, and the calibration errors that it shows, taken out.

All cameras look at one table, so what separates their tables is calibration error: roll, pitch and height of
each camera follow from it; x, y and yaw cannot.
"""

from dataclasses import dataclass, replace

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.perception.cloud import Cloud
from dexgrasp_env.poses import least_turn, rigid

TOLERANCE = 0.010  # m within which points are the table's
_TILT = np.radians(8.0)  # steeper hypotheses are dropped


@dataclass(frozen=True, eq=False)
class Plane:
    """The plane normal . x = offset, world frame.

    Attributes:
        normal: (3,) unit, upwards.
        offset: metres.
        rms: RMS distance of the points it was fitted to, metres; a measure of the sensor's noise.
    """

    normal: Array
    offset: float
    rms: float

    @staticmethod
    def to_array(plane: "Plane | None") -> Array:
        """Return normal, offset and RMS (5,) as observations hold them; zeros for no plane."""
        return np.zeros(5) if plane is None else np.array([*plane.normal, plane.offset, plane.rms])

    @classmethod
    def from_array(cls, values: Array) -> "Plane | None":
        """Return what `to_array` (5,) was made of; None for no plane."""
        values = np.asarray(values, dtype=float)
        if np.linalg.norm(values[:3]) < 0.5:
            return None
        return cls(values[:3], float(values[3]), float(values[4]))

    def placed(self, T: Array) -> "Plane":
        """Return it in a frame in which its own has pose `T` (4, 4)."""
        normal = T[:3, :3] @ self.normal
        return replace(self, normal=normal, offset=self.offset + float(normal @ T[:3, 3]))

    def heights(self, points: Array) -> Array:
        """Signed distance of points (..., 3) above the plane, metres."""
        return np.einsum("...i,i->...", points, self.normal) - self.offset


def fit_plane(
    points: Array, rng: np.random.Generator, *, off: float = 0.05, min_inliers: int = 200, tilt: float = _TILT,
    within: float | None = None, triples: int = 64,
) -> Plane | None:  # fmt: skip
    """Fit the table by RANSAC (Fischler and Bolles 1981) and least squares on its inliers.

    Args:
        points: (M, 3) m, world frame, where the table is expected at z = 0.
        rng: draws the subsample and the triples.
        off: points farther above or below have no say, metres.
        min_inliers: fewer inliers are no table.
        tilt: rad from level up to which planes are looked at.
        within: m from it, points are its inliers, which count the more the nearer they are (MSAC, Torr and Zisserman
            2000); None: 10 mm, and all count alike.
        triples: tried.

    Returns:
        The plane, or None if there is none.
    """
    near = points[np.abs(points[:, 2]) < off]
    if len(near) < max(min_inliers, 3):
        return None
    samples = 1500  # points on which hypotheses are scored
    pool = near[rng.integers(len(near), size=samples)]
    drawn = pool[rng.integers(samples, size=(triples, 3))]
    normals = np.cross(drawn[:, 1] - drawn[:, 0], drawn[:, 2] - drawn[:, 0])
    length = np.sqrt((normals * normals).sum(-1))
    fit = np.abs(normals[:, 2]) > np.cos(tilt) * np.maximum(length, 1e-12)
    if not fit.any():
        return None
    normals = normals[fit] / (length * np.sign(normals[:, 2]))[fit, None]
    offsets = (normals * drawn[fit, 0]).sum(-1)
    away = pool @ normals.T - offsets
    scores = np.abs(away) < TOLERANCE if within is None else np.maximum(1.0 - (away / within) ** 2, 0.0)
    best = scores.sum(0).argmax()
    return refine_plane(near, normals[best], float(offsets[best]), within or TOLERANCE, min_inliers)


def refine_plane(
    points: Array, normal: Array, offset: float, tolerance: float = TOLERANCE, min_inliers: int = 200
) -> Plane | None:
    """Return the least-squares plane of the points within `tolerance` m of a first guess, None if too few."""
    for _ in range(3):
        distance = np.einsum("ij,j->i", points, normal) - offset
        inliers = points.take(np.flatnonzero(np.abs(distance) < tolerance), axis=0)
        if len(inliers) < min_inliers:
            return None
        normal, offset, rms = _least_squares(inliers)
        tolerance = min(tolerance, max(3.0 * rms, 5e-4))
    return Plane(normal, offset, rms)


def _least_squares(points: Array) -> tuple[Array, float, float]:
    centre = points.mean(0)
    local = points - centre
    values, vectors = np.linalg.eigh(local.T @ local / len(points))
    normal = vectors[:, 0] * np.sign(vectors[2, 0])
    return normal, float(normal @ centre), float(np.sqrt(max(values[0], 0.0)))


def table_clearance(plane: Plane, cloud: Cloud, depth: Array, sigmas: float) -> Array:
    """Return the heights (M,) m below which points may be table noise.

    Noise grows with depth^2, so the RMS over the table is that at the root mean fourth power of its depths.

    Args:
        plane: the table with its RMS.
        cloud: points of it, and others.
        depth: (M,) m, of the points that are judged.
        sigmas: how much of the noise's tail is table.
    """
    table = cloud.depth[np.abs(plane.heights(cloud.points)) < TOLERANCE]
    reference = float((table**4).mean() ** 0.25) if len(table) else 1.0
    return np.maximum(0.002, sigmas * plane.rms * (depth / reference) ** 2)


def view_corrections(cloud: Cloud, plane: Plane, views: int) -> Array:
    """Return the transform that lays each view's own table into the common plane, (views, 4, 4).

    Args:
        cloud: points of all views, table included.
        plane: the common table.
        views: number of cameras.
    """
    corrections = np.tile(np.eye(4), (views, 1, 1))
    common = 0.012  # m: points of a view this close to the plane of all views count as table
    table = np.abs(plane.heights(cloud.points)) < common
    for k in range(views):
        own = cloud.points[table & (cloud.camera == k)]
        fit = refine_plane(own, plane.normal, plane.offset, common, 100)
        if fit is not None:
            corrections[k] = _onto(fit, plane, own.mean(0))
    return corrections


def level_views(cloud: Cloud, corrections: Array) -> Cloud:
    """Return the cloud with every point moved by the correction of its view."""
    points = cloud.points.copy()
    for k, T in enumerate(corrections):
        rows = np.flatnonzero(cloud.camera == k)
        points[rows] = points[rows] @ T[:3, :3].T + T[:3, 3]
    return cloud.moved(points)


def _onto(own: Plane, common: Plane, centre: Array) -> Array:
    """Return the pose (4, 4) that lays a plane into a nearby one by the smallest turn about a point."""
    pivot = centre - own.heights(centre) * own.normal
    R = least_turn(own.normal, common.normal)
    return rigid(R, pivot - common.heights(pivot) * common.normal - R @ pivot)
