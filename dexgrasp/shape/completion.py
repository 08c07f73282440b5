"""The hull of a cloud, the side that no camera saw completed, with how far it may be off."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp.shape.hull import cloud_corners
from dexgrasp.shape.network import CompletionNetwork, shipped_network
from dexgrasp.shape.parts import parts_within
from dexgrasp.shape.target import GraspTarget, Spread
from dexgrasp.shape.view import ONE_SIDED, UNIT, WRITTEN, View, one_sidedness
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.plane import Plane

_LEAST_INSIDE = 0.003 / UNIT  # radius of the largest ball inside, below which there is no volume to speak of


def target_of_cloud(
    points: NDArray[Any], normals: NDArray[Any], plane: Plane | None, mass: float | None = None
) -> GraspTarget | None:
    """Return the object that a cloud shows, or None where its points span no volume to speak of.

    Args:
        points: (N, 3) m, of the object alone, world frame.
        normals: (N, 3) out of the object.
        plane: the table, on which it stands.
        mass: kg; assumed if None.
    """
    hull, spread = completed_corners(points, normals, plane)
    if hull is None:
        return None
    parts = [hull] if spread is not None else parts_within(hull, points, plane)
    try:
        return GraspTarget.of_corners(parts, mass=mass, spread=spread)
    except InputError:
        return None


def completed_corners(
    points: NDArray[Any], normals: NDArray[Any], plane: Plane | None, network: CompletionNetwork | None = None
) -> tuple[Array | None, Spread | None]:
    """Return the corners (N, 3) m of the hull of what a cloud shows, and the spread of one that was completed.

    A cloud whose normals do not all point one way shows the object all round: they are `cloud_corners`.

    Args:
        points: (N, 3) m, world frame.
        normals: (N, 3) out of the object.
        plane: the table; None completes nothing.
        network: that completes; the shipped one by default.
    """
    points, normals = np.asarray(points, dtype=float), np.asarray(normals, dtype=float)
    if plane is None or len(points) < 4 or one_sidedness(normals) < ONE_SIDED:
        return cloud_corners(points, plane), None
    view = View.of(points, normals, plane)
    support, spread = (network or shipped_network()).complete(view)
    corners = _corners(support)
    if corners is None:
        return cloud_corners(points, plane), None
    return cloud_corners(corners * UNIT @ view.R + view.origin), Spread(WRITTEN @ view.R, spread)


def _corners(support: Array) -> Array | None:
    """Return corners (N, 3), UNIT, of what lies within a support (361,) and above the table; None if nothing does."""
    from scipy.optimize import linprog
    from scipy.spatial import HalfspaceIntersection, QhullError

    normals = np.concatenate([WRITTEN, [[0.0, 0.0, -1.0]]])
    most = np.append(support, 0.0)
    # The centre of the largest ball inside: half-spaces are cut around it.
    ball = linprog([0.0, 0.0, 0.0, -1.0], np.c_[normals, np.ones(len(normals))], most, bounds=(None, None))
    if not ball.success or ball.x[3] < _LEAST_INSIDE:
        return None
    try:
        corners: Array = HalfspaceIntersection(np.c_[normals, -most], ball.x[:3]).intersections
    except QhullError:
        return None
    return corners[np.isfinite(corners).all(1)]
