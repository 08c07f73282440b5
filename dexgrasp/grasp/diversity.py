"""Diversity of the grasps of one scene: distances between hands, and principal components as DexGraspBench has them."""

import numpy as np
from scipy.spatial.transform import Rotation

from dexgrasp.grasp.grasp import Grasp
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.tree import RobotTree, robot_tree
from dexgrasp_env.arrays import Array


def component_shares(features: Array) -> list[float]:
    """Return the share of variance that the first 1 to 5 principal components explain; lower is more varied.

    Empty for fewer than three rows, or rows that are all the same.

    Args:
        features: (N, F), unscaled.
    """
    if len(features) < 3:
        return []
    variances = np.linalg.svd(features - features.mean(0), compute_uv=False) ** 2
    if variances.sum() <= 1e-16:  # of the sum of squares: what rounding leaves of equal grasps
        return []
    return np.cumsum(variances / variances.sum())[:5].tolist()


def grasp_features(grasp: Grasp) -> Array:
    """Return palm position, m, its rotation vector, rad, and the hand's joints, rad: (6 + h,), world frame."""
    tree = robot_tree(grasp.cell)
    R, p = palm_frame(grasp.q, tree)
    return np.concatenate([p, Rotation.from_matrix(R).as_rotvec(), grasp.q[tree.arm :]])


def hand_points(q: Array, contacts: Array, tree: RobotTree) -> Array:
    """Return points (g + 3, 3) m that stand for a hand: its contacts, its palm, and 10 cm along two palm axes.

    Two grasps are as far apart as the root mean square of these points' distances.
    """
    R, p = palm_frame(q, tree)
    # m along the palm's axes: as far as the hand reaches
    return np.concatenate([contacts, p[None], p + 0.1 * R[:, :2].T])
