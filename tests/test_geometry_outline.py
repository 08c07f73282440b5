import numpy as np
import pytest
from scipy.spatial import ConvexHull

from dexgrasp.geometry.quickhull import extreme_points


def ball(count, seed=0):
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return 0.05 * points / np.linalg.norm(points, axis=1, keepdims=True)


def cube(n):
    """Points (N, 3) in a lattice: most lie in planes and on lines with many others, and many are doubled."""
    at = np.linspace(0.0, 0.1, n)
    lattice = np.stack(np.meshgrid(at, at, at), -1).reshape(-1, 3)
    return np.concatenate([lattice, lattice[::3]])


def test_corners_come_before_what_tells_nothing():
    points = cube(7)
    found = points[extreme_points(points, 24)]
    assert ConvexHull(found).volume == pytest.approx(1e-3, rel=1e-4)


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
