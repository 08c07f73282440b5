"""What planning takes from an observation, checked: start, points, the target."""

import numpy as np

from dexgrasp.agent import Observation
from dexgrasp.shape.completion import target_of_cloud
from dexgrasp.shape.target import GraspTarget
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.plane import Plane
from dexgrasp_env.robot.limits import LOWER, UPPER

NO_CLOUD, NO_HULL = "empty_cloud", "cloud_has_no_volume"
_LONGEST = 1.001  # of a unit vector in single precision
_BEYOND = 0.1  # rad that set-points may be outside the joint ranges: servos and noise


def start_of(observation: Observation) -> Array:
    """Return the set-points (23,) rad that an episode begins with.

    Raises:
        InputError: where the robot cannot be there: planning from such a start takes minutes to fail.
    """
    start = np.asarray(observation["joint_targets"], dtype=float)
    if start.shape != LOWER.shape or not ((start > LOWER - _BEYOND) & (start < UPPER + _BEYOND)).all():
        raise InputError(f"joint_targets must be {len(LOWER)} set-points within the joint ranges, in rad")
    return start


def target_from_cloud(observation: Observation) -> tuple[GraspTarget | None, str | None]:
    """Return the object of a point-cloud observation, or the reason why there is none."""
    points = points_of(observation)
    if len(points) < 4:
        return None, NO_CLOUD
    plane = Plane.from_array(observation["table_plane"])
    target = target_of_cloud(points, normals_of(observation), plane)
    return target, NO_HULL if target is None else None


def points_of(observation: Observation) -> Array:
    """Return the points (N, 3) m of the cloud that count and are numbers.

    Raises:
        InputError: where the observation has no cloud.
    """
    return _counted(observation, "cloud")


def normals_of(observation: Observation) -> Array:
    """Return the normals (N, 3) of `points_of`, zeros where one is not a number, none longer than 1.

    Raises:
        InputError: where the observation has no cloud.
    """
    normals = np.nan_to_num(_counted(observation, "cloud_normals"), posinf=0.0, neginf=0.0)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > _LONGEST, normals / np.maximum(length, 1.0), normals)


def _counted(observation: Observation, key: str) -> Array:
    """Rows (N, 3) of a part of the cloud for the points that count."""
    if not {"cloud", "cloud_mask", key} <= observation.keys():
        raise InputError(
            "this agent plans from a point cloud: make the environment with obs_mode='pointcloud'"
        )
    points = np.asarray(observation["cloud"], dtype=float)
    mask = np.asarray(observation["cloud_mask"], dtype=bool)
    return np.asarray(observation[key], dtype=float)[mask & np.isfinite(points).all(axis=1)]
