"""Measures of a grasp for evaluation: exact, any number of contacts and edges, not fast."""

import numpy as np

from agents.physics.checks import Numbers, check_array, check_contacts, check_positive, rms_radius
from agents.physics.cones import cone_edges
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError


def edge_wrenches(
    points: Array,
    normals: Array,
    mu: float,
    edges: int = 4,
    center: Array | None = None,
    length_scale: float | None = None,
) -> Array:
    """Wrenches (N * edges, 6) of the inscribed pyramids' edges, each pressing 1, about `center`."""
    center = points.mean(0) if center is None else center
    scale = rms_radius(points) if length_scale is None else length_scale
    force = cone_edges(normals, mu, edges)
    torque = np.cross((points - center)[:, None], force) / scale
    return np.concatenate([force, torque], axis=-1).reshape(-1, 6)


def min_weight_lp(points: Numbers, normals: Numbers, mu: float, edges: int = 4) -> float:
    """Min-weight of any number of contacts and edges, by HiGHS: exact, slow (a millisecond or two).

    Returns:
        Min-weight as `margin` defines it; -inf where no affine combination of the wrenches vanishes.
    """
    from scipy.optimize import linprog

    points, normals = check_contacts(points, normals)
    W = edge_wrenches(points, normals, check_positive("mu", mu), edges)
    m = len(W)
    A_eq = np.zeros((7, m + 1))
    A_eq[:6, :m], A_eq[6, :m] = W.T, 1.0
    A_ub = np.hstack([-np.eye(m), np.ones((m, 1))])
    cost = np.r_[np.zeros(m), -1.0]
    answer = linprog(
        cost, A_ub, np.zeros(m), A_eq, np.r_[np.zeros(6), 1.0], bounds=(None, None), method="highs"
    )
    return float(-answer.fun * m) if answer.status == 0 else -np.inf


def ferrari_canny(
    points: Numbers,
    normals: Numbers,
    mu: float,
    center: Numbers = None,
    torque_scale: float | None = None,
    edges: int = 8,
) -> float:
    """Radius of the largest ball about zero in the hull of the edge wrenches (Ferrari and Canny, 1992).

    Args:
        points: (N, 3) metres. normals: (N, 3) unit, out of the object. mu: friction coefficient.
        center: (3,) torque reference; None is the centroid of the contacts. Unlike min-weight, epsilon
            depends on it.
        torque_scale: length that divides torques [m]; None is the contacts' rms radius.
        edges: edges of each inscribed pyramid; an edge presses 1 N.

    Returns:
        The radius [N]; 0 where the hull does not contain zero, or is flat.
    """
    from scipy.spatial import ConvexHull, QhullError

    points, normals = check_contacts(points, normals)
    reference = points.mean(0) if center is None else check_array("center", center, (3,))
    scale = rms_radius(points) if torque_scale is None else check_positive("torque_scale", torque_scale)
    if len(points) < 2:
        raise InputError(f"epsilon needs at least 2 contacts, got {len(points)}")
    W = edge_wrenches(points, normals, check_positive("mu", mu), edges, reference, scale)
    if np.linalg.matrix_rank(W - W[0], tol=1e-9) < 6:
        return 0.0
    try:
        return max(0.0, float(-ConvexHull(W).equations[:, -1].max()))
    except QhullError:
        return 0.0
