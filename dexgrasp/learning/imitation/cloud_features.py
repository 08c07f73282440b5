"""Features of a policy cloned from clouds: the cloud of the object, in the frame of each candidate grip.

A grip is a level line with an azimuth, from the thumb to the fingers. In a frame turned about the vertical so that this
line is x, scenes that are grasped alike have equal features, however the object lies: the network decides whether to
grip along x, and how.
"""

from typing import Any, NamedTuple

import numpy as np

from dexgrasp.agent import Observation
from dexgrasp_env.arrays import Array, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import about_z
from dexgrasp_env.tasks.features import METRES, entry

POINTS = 192
"""Number of points of a cloud in the network's input."""
_KEPT = 512  # points kept of an observed cloud
_LEVEL = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
_DIRECTIONS = np.stack([np.cos(_LEVEL), np.sin(_LEVEL)])  # (2, 24)
NUMBERS = 7 + len(_LEVEL)
"""Number of features of a scene beside its points."""


class ObservedCloud(NamedTuple):
    """Observed cloud of an object.

    Attributes:
        points: (N, 3) m, world frame.
        middle: (3,) m, their mean.
        seen: (512, 6) evenly chosen ones: positions about the middle in network units, and normals.
    """

    points: Array
    middle: Array
    seen: Single


def observed_cloud(first: Observation) -> ObservedCloud:
    """Return the object's cloud in the first observation of an episode.

    Raises:
        InputError: without a cloud, or with fewer than 20 points.
    """
    if not {"cloud", "cloud_mask", "cloud_normals"} <= first.keys():
        raise InputError(
            "this policy looks at a point cloud: make the environment with obs_mode='pointcloud'"
        )
    points, normals = (entry(first, key) for key in ("cloud", "cloud_normals"))
    there = np.asarray(first["cloud_mask"], dtype=bool) & np.isfinite(points).all(axis=1)
    if there.sum() < 20:
        raise InputError("empty_cloud")
    points, normals = points[there], normals[there]
    middle, chosen = points.mean(axis=0), np.linspace(0, len(points) - 1, _KEPT).round().astype(int)
    seen = np.concatenate([METRES * (points - middle), normals], axis=1)[chosen]
    return ObservedCloud(points, middle, seen.astype(np.float32))


def grip_features(
    cloud: ObservedCloud, azimuths: Array, rng: np.random.Generator | None = None
) -> tuple[Any, Any]:
    """Return points (m, POINTS, 6) and features (m, NUMBERS) in the frames of grips of azimuths (m,) rad.

    With a random generator the points are drawn, otherwise chosen evenly.
    """
    if rng is None:
        chosen = np.linspace(0, _KEPT - 1, POINTS).round().astype(int)
    else:
        chosen = rng.integers(_KEPT, size=POINTS)
    turns = about_z(-azimuths)
    halves = cloud.seen[chosen].reshape(POINTS * 2, 3) @ turns.swapaxes(-1, -2)
    points = halves.reshape(len(turns), POINTS, 6)
    base = np.arctan2(cloud.middle[1], cloud.middle[0]) - azimuths
    reach = (points[..., :2] @ _DIRECTIONS).max(axis=1)
    heights = np.array([np.hypot(*cloud.middle[:2]), cloud.middle[2], cloud.points[:, 2].max()]) * METRES
    numbers = [np.cos(base), np.sin(base), np.cos(2 * base), np.sin(2 * base)]
    scene = np.concatenate([np.stack(numbers, axis=1), np.tile(heights, (len(turns), 1)), reach], axis=1)
    return points.astype(np.float32), scene.astype(np.float32)
