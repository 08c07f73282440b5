"""Plain, slow statements of what fast code must satisfy; nothing outside the tests uses them."""

import numpy as np

from dexgrasp.mechanics.closure import closure_sweep
from dexgrasp.mechanics.cones import tangent_basis


def sample_box(n, rng, half=(0.03, 0.08, 0.105)):
    """Points and normals (n, 3), uniform on a box of half-lengths `half` [m]."""
    size = np.array(half)
    area = size.prod() / size
    axis, side = rng.choice(3, n, p=area / area.sum()), rng.choice([-1.0, 1.0], n)
    points, normals = rng.uniform(-1, 1, (n, 3)) * size, np.zeros((n, 3))
    points[np.arange(n), axis], normals[np.arange(n), axis] = side * size[axis], side
    return points, normals


def sample_can(n, rng, radius=0.033, half=0.05):
    """Points and normals (n, 3), uniform on a cylinder [m]."""
    wall = rng.random(n) < 2 * half / (2 * half + radius)
    angle, end = rng.uniform(0, 2 * np.pi, n), rng.choice([-1.0, 1.0], n)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], 1)
    up = np.array([0.0, 0.0, 1.0])
    on_wall = radius * ring + rng.uniform(-half, half, (n, 1)) * up
    on_end = radius * np.sqrt(rng.random((n, 1))) * ring + half * end[:, None] * up
    points = np.where(wall[:, None], on_wall, on_end)
    return points, np.where(wall[:, None], ring, end[:, None] * up)


def pyramid_violation(forces, normals, mu):
    """Return by how much [N] forces (N, 3) break Eq. 2: max(-press, |f.t_j| - mu press); <= 0 inside."""
    press = -(forces * normals).sum(-1)
    friction = np.max([np.abs((forces * t).sum(-1)) for t in tangent_basis(normals)], axis=0)
    return np.maximum(-press, friction - mu * press)


def random_grasps(K, seed=0):
    """Return points and unit normals (K, 3, 3) m, these leaning outwards."""
    rng = np.random.default_rng(seed)
    p = 0.05 * rng.normal(size=(K, 3, 3))
    n = rng.normal(size=(K, 3, 3)) + p / 0.03
    return p, n / np.linalg.norm(n, axis=-1, keepdims=True)


def box_distance(points, sides):
    """Return signed distances (N,) of points (N, 3) to a box about the origin."""
    q = np.abs(points) - sides / 2
    return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)


def closed(points, normals, mu, scale=None):
    """Return which of triples (K, 3, 3) the sweep accepts (K,), one at a time."""
    return np.array(
        [len(closure_sweep(p, n, mu, 0.0, scale)) == 1 for p, n in zip(points, normals, strict=True)]
    )
