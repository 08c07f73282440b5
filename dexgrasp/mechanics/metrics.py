"""The measure of a grasp that others report: Ferrari and Canny's epsilon."""

import numpy as np

from dexgrasp.mechanics.checks import Numbers, check_contacts, check_positive
from dexgrasp.mechanics.cones import cone_edges
from dexgrasp.mechanics.equilibrium import rms_radius
from dexgrasp_env.errors import InputError

_EDGES = 8  # of each inscribed pyramid


def ferrari_canny(points: Numbers, normals: Numbers, mu: float, torque_scale: float | None = None) -> float:
    """Radius of the largest ball about zero in the hull of the edge wrenches (Ferrari and Canny, 1992).

    Args:
        points: (N, 3) metres. normals: (N, 3) unit, out of the object. mu: friction coefficient.
        torque_scale: length that divides torques [m]; None is the contacts' rms radius.

    Returns:
        The radius [N], edges pressing 1 N and torques being about the centroid of the contacts: unlike the closure
        margin, epsilon depends on that. 0 where the hull does not contain zero, or is flat.
    """
    from scipy.spatial import ConvexHull, QhullError

    points, normals = check_contacts(points, normals)
    scale = rms_radius(points) if torque_scale is None else check_positive("torque_scale", torque_scale)
    if len(points) < 2:
        raise InputError(f"epsilon needs at least 2 contacts, got {len(points)}")
    force = cone_edges(normals, mu, _EDGES)
    torque = np.cross((points - points.mean(0))[:, None], force) / scale
    wrenches = np.concatenate([force, torque], axis=-1).reshape(-1, 6)
    if np.linalg.matrix_rank(wrenches - wrenches[0], tol=1e-9) < 6:
        return 0.0
    try:
        return max(0.0, float(-ConvexHull(wrenches).equations[:, -1].max()))
    except QhullError:
        return 0.0
