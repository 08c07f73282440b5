"""Calibration errors that the table shows, taken out.

All cameras look at one table, so what separates their tables is calibration error: roll, pitch and height of
each camera follow from it; x, y and yaw cannot.
"""

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array
from dexgrasp_env.perception.cloud import Cloud
from dexgrasp_env.perception.plane import Plane, refine_plane
from dexgrasp_env.poses import rigid

_TOLERANCE = 0.012  # m: points this close to the common plane count as table
_LEAST = 100  # points: a view with fewer of them stays as it is


def view_corrections(cloud: Cloud, plane: Plane, views: int) -> NDArray[np.float64]:
    """Return the transform that lays each view's own table into the common plane, (views, 4, 4).

    Args:
        cloud: points of all views, table included.
        plane: the common table.
        views: number of cameras.
    """
    corrections = np.tile(np.eye(4), (views, 1, 1))
    table = np.abs(plane.heights(cloud.points)) < _TOLERANCE
    for k in range(views):
        own = cloud.points[table & (cloud.camera == k)]
        if len(own) < _LEAST:
            continue
        fit = refine_plane(own, plane.normal, plane.offset, _TOLERANCE, _LEAST)
        if fit is not None:
            corrections[k] = _onto(fit, plane, own.mean(0))
    return corrections


def level_views(cloud: Cloud, corrections: NDArray[np.float64]) -> Cloud:
    """Return the cloud with every point moved by the correction of its view."""
    points = cloud.points.copy()
    for k, T in enumerate(corrections):
        rows = np.flatnonzero(cloud.camera == k)
        points[rows] = points[rows] @ T[:3, :3].T + T[:3, 3]
    return cloud.moved(points)


def _onto(own: Plane, common: Plane, centre: Array) -> Array:
    pivot = centre - own.heights(centre) * own.normal
    R = _smallest_turn(own.normal, common.normal)
    return rigid(R, pivot - common.heights(pivot) * common.normal - R @ pivot)


def _smallest_turn(a: Array, b: Array) -> Array:
    """Return the smallest rotation that takes unit vector a to the nearby unit vector b (Rodrigues)."""
    v = np.cross(a, b)
    K = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + K + K @ K / (1.0 + a @ b)
