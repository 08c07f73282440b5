"""The convex hull of a cloud, trimmed of noise and completed down to the table."""

from functools import cache

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp_env.arrays import Array, fibonacci_directions
from dexgrasp_env.perception.plane import Plane

REACH = 0.020
"""m above the table within which points are dropped onto it."""


def cloud_corners(points: Array, plane: Plane | None = None) -> Array | None:
    """Return the corners of the convex hull of the points in the world frame, trimmed for the plane's noise.

    No camera sees the underside, and points near the table are removed with it. The object stands on the
    table, so points within `REACH` of the plane are dropped straight onto it before the hull is taken, and
    the point of the table under the middle of the cloud is added: a ball, say, whose lowest visible points are
    higher, then ends in a cone. Where only the upper half was seen, as from straight above, walls go straight down.

    Args:
        points: (M, 3) m.
        plane: the table; None completes and trims nothing.

    Returns:
        (N, 3) m, or None if the points span no volume.
    """
    points = np.asarray(points, dtype=float)
    if len(points) < 4:
        return None
    if plane is not None:
        points = trim_extremes(points, plane.rms)
        heights = plane.heights(points)
        dropped = points - heights[:, None] * plane.normal
        if np.quantile(heights, 0.02) > max(REACH, 0.5 * heights.max()):  # hardly a point is low
            heights = np.zeros_like(heights)
        points = np.concatenate([points, dropped[heights < REACH], np.median(dropped, axis=0, keepdims=True)])
    try:
        return points[ConvexHull(points).vertices]
    except QhullError:  # all points in a plane or on a line
        return None


def standing_hull(points: Array) -> ConvexDistance:
    """Return the convex hull of a cloud (M, 3) m and its shadow on the table: what cameras miss is below what they see.

    Raises:
        InputError: if the points span no volume.
    """
    shadow = points * [1.0, 1.0, 0.0]
    return ConvexDistance.from_points(np.concatenate([points, shadow]), max_faces=80)


def axes_of_symmetry(corners: Array) -> Array:
    """Return the axes (K, 3) about which the hull of corners (N, 3) m is a body of revolution: none, 1, or a ball's 3.

    Turned about one of them its support nowhere changes by a tenth of its radius: a hexagon's would by 0.13.
    """
    import trimesh

    hull = trimesh.convex.convex_hull(corners)
    about, axes = hull.vertices - hull.center_mass, np.array(hull.principal_inertia_vectors)
    turns = np.arange(0.0, 2.0 * np.pi, np.pi / 12.0)[:, None]
    found = []
    for k in range(3):
        level = np.cos(turns) * axes[k - 1] + np.sin(turns) * axes[k - 2]
        support = np.array([(about @ (level + slope * axes[k]).T).max(0) for slope in (-1.0, 0.0, 1.0)])
        if np.ptp(support, axis=1).max() < 0.1 * support[1].mean():
            found.append(axes[k])
    return np.reshape(found, (-1, 3))


def trim_extremes(points: Array, noise: float) -> Array:
    """Return the points (M, 3) with those that stick out moved inwards.

    A hull is made of extremes, and those of noisy points lie outside the surface: of boxes, cans, balls, cones and a
    tetrahedron, seen by the default sensor, it would be 13 % too large.

    In each of many directions, the farthest 1 % of the points are moved back to the next one and 0.3 of the
    noise farther. Downwards nothing is moved: the table ends the object there. Without noise nothing is
    moved at all.
    """
    count = round(0.01 * min(1.0, noise / 0.001) * len(points))
    if count < 1:
        return points
    outward = _outward()
    centre = np.median(points, axis=0)
    local = points - centre
    along = outward @ local.T
    farthest = np.partition(along, -count - 1, axis=1)[:, -count - 1]
    limit = np.maximum(farthest - 0.3 * noise, 0.0)
    out = np.flatnonzero((along > limit[:, None]).any(0))
    moved = _moved(local[out], along[:, out] - limit[:, None], outward)
    # A corner sticks out in more than one direction.
    local[out] = _moved(moved, outward @ moved.T - limit[:, None], outward)
    return local + centre


def _moved(points: Array, excess: Array, outward: Array) -> Array:
    """Move points (M, 3) back by the most that they stick out of limits in directions (K, 3): `excess` (K, M)."""
    worst = excess.argmax(axis=0)
    back = np.maximum(excess[worst, np.arange(len(points))], 0.0)
    return points - back[:, None] * outward[worst]


@cache
def _outward() -> Array:
    """Even directions (n, 3) over the upper half sphere and a little below its equator."""
    directions = fibonacci_directions(300)
    return directions[directions[:, 2] > -0.1]
