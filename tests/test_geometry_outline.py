import numpy as np
import pytest
from scipy.spatial import ConvexHull

from dexgrasp.geometry.quickhull import extreme_points


def ball(count, seed=0):
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return 0.05 * points / np.linalg.norm(points, axis=1, keepdims=True)


@pytest.mark.parametrize("seed", range(5))
def test_each_point_brings_most_of_what_is_left(seed):
    points = ball(400, seed)
    chosen = extreme_points(points, 40)
    assert len(set(chosen.tolist())) == 40
    for n in (10, 20, 39):
        hull = ConvexHull(points[chosen[:n]])
        height = (points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(1)
        assert height[chosen[n]] > height.max() - 1e-5


def test_ends_where_the_hull_of_fewer_holds_all():
    octahedron = np.concatenate([np.eye(3), -np.eye(3)])
    inside = 0.2 * ball(50) / 0.05
    assert sorted(extreme_points(np.concatenate([octahedron, inside]), 30)) == list(range(6))
