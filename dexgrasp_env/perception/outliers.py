"""Points that belong to nothing, removed."""

import numpy as np

from dexgrasp_env.perception.cloud import Cloud


def remove_outliers(cloud: Cloud, radius: float = 0.012, least: int = 4) -> Cloud:
    """Return the points with at least `least` others within `radius` metres (Open3D's radius filter)."""
    if len(cloud) <= least:
        return cloud.select(np.zeros(len(cloud), bool))
    from dexgrasp_env.perception.kernels import count_neighbours

    return cloud.select(count_neighbours(np.ascontiguousarray(cloud.points), radius) >= least)


def largest_cluster(cloud: Cloud, link: float = 0.015) -> Cloud:
    """Return the largest set of points linked by steps of at most `link` metres."""
    if not len(cloud):
        return cloud
    from dexgrasp_env.perception.kernels import cluster

    labels = cluster(np.ascontiguousarray(cloud.points), link)
    return cloud.select(labels == np.bincount(labels).argmax())
