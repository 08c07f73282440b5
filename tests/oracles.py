"""Plain, slow statements of what fast code must satisfy; nothing outside the tests uses them."""

import numpy as np

from dexgrasp.physics.cones import tangent_basis


def project_to_cone(forces, normals, mu):
    """Return the nearest forces (N, 3) in the exact friction cones (Eq. 1)."""
    press = -(forces * normals).sum(-1, keepdims=True)
    tangent = forces + press * normals
    size = np.linalg.norm(tangent, axis=-1, keepdims=True)
    along = np.maximum(0.0, (press + mu * size) / (1.0 + mu * mu))
    direction = np.divide(tangent, size, out=np.zeros_like(tangent), where=size > 0)
    onto = along * (mu * direction - normals)
    return np.where(size <= mu * press, forces, np.where(mu * size <= -press, 0.0, onto))


def cone_distance(forces, normals, mu):
    """Return the distances [N] (N,) of forces (N, 3) from the exact cones: 0 inside."""
    return np.linalg.norm(forces - project_to_cone(forces, normals, mu), axis=-1)


def pyramid_violation(forces, normals, mu):
    """Return by how much [N] forces (N, 3) break Eq. 2: max(-press, |f.t_j| - mu press); <= 0 inside."""
    press = -(forces * normals).sum(-1)
    friction = np.max([np.abs((forces * t).sum(-1)) for t in tangent_basis(normals)], axis=0)
    return np.maximum(-press, friction - mu * press)


def directional_error(value, arguments, gradients, moves, step=1e-6):
    """Return how far the analytic slope of `value(*arguments)` along `moves` is from the central difference."""
    ends = [value(*(a + s * m for a, m in zip(arguments, moves, strict=True))) for s in (step, -step)]
    numeric = (ends[0] - ends[1]) / (2 * step)
    analytic = sum((g * m).sum() for g, m in zip(gradients, moves, strict=True))
    return abs(numeric - analytic) / (1 + abs(numeric))
