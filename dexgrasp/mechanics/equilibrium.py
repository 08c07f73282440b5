"""Forces at contacts that balance: internal forces, and answers of least norm to a force on the object.

Contacts whose grasp matrix has rank 6 balance any wrench, and all forces that do are one answer to it and internal
forces: of three points those along the sides of their triangle. Two points, or points on a line, have rank 5 at most;
soft contacts, which turn about their normals as well, need not lie apart.
"""

import numpy as np

from dexgrasp.mechanics.contacts import Contacts
from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import njit

FLAT = 2e-3
"""Height of a triangle over its longest side, below which contacts count as lying on a line; of other contacts the
least singular value of their grasp matrix over the largest."""


@njit
def grasp_map(points: Array, centre: Array, scale: float) -> Array:
    """Return the matrix (6, 3 N) from forces at points (N, 3) to their wrench about `centre` (3,), torques / scale."""
    G = np.zeros((6, points.size))
    for i in range(points.shape[0]):
        r = (points[i] - centre) / scale
        for k in range(3):
            u, v = (k + 1) % 3, (k + 2) % 3
            G[k, 3 * i + k], G[3 + k, 3 * i + v], G[3 + k, 3 * i + u] = 1.0, r[u], -r[v]
    return G


@njit
def contact_map(points: Array, normals: Array, torsion: float | None, centre: Array, scale: float) -> Array:
    """Return the grasp matrix (6, c N) from forces (N, c) to their wrench about `centre` (3,), torques / scale.

    `torsion` is that of the contact model: where it is None, the rest is not compiled.
    """
    if torsion is None:
        return grasp_map(points, centre, scale)
    G, soft = grasp_map(points, centre, scale), np.zeros((6, 4 * points.shape[0]))
    for i in range(points.shape[0]):
        soft[:, 4 * i : 4 * i + 3] = G[:, 3 * i : 3 * i + 3]
        soft[3:, 4 * i + 3] = torsion / scale * normals[i]
    return soft


@njit
def own_map(points: Array, normals: Array, torsion: float | None) -> Array:
    """Return `contact_map` about the contacts' middle, torques over their rms radius."""
    middle = np.zeros(3)
    for i in range(points.shape[0]):
        middle += points[i] / points.shape[0]
    away = points - middle
    radius = max(np.sqrt((away * away).sum() / points.shape[0]), 1e-9)  # of contacts at one point too
    return contact_map(points, normals, torsion, middle, radius)


@njit
def internal_forces(points: Array, normals: Array, torsion: float | None, internal: Array) -> float:
    """Write a basis of the forces that balance; return how far contacts are from leaving some wrench free: see `FLAT`.

    Args:
        points: (N, 3) m.
        normals: (N, 3) out of the object.
        torsion: of the contact model.
        internal: (N, c, c N - 6 or more), written: contact, part, force.
    """
    if points.shape[0] == 3 and internal.shape[1] == 3:
        return _sides(points, internal)
    _, sizes, rows = np.linalg.svd(own_map(points, normals, torsion))
    for i in range(internal.shape[0]):
        for k in range(internal.shape[1]):
            for q in range(len(rows) - 6):
                internal[i, k, q] = rows[6 + q, internal.shape[1] * i + k]
    return sizes[5] / sizes[0]


@njit
def _sides(points: Array, internal: Array) -> float:
    """Write the unit forces along the sides of a triangle; return its height over its longest side."""
    longest, area = 0.0, 0.0
    for side in range(3):
        i, j = (0, 1) if side == 0 else (0, 2) if side == 1 else (1, 2)
        squared = 0.0
        for k in range(3):
            squared += (points[j, k] - points[i, k]) ** 2
        longest = max(longest, squared)
        length = np.sqrt(squared)
        for k in range(3):
            along = (points[j, k] - points[i, k]) / length
            internal[i, k, side], internal[j, k, side], internal[3 - i - j, k, side] = along, -along, 0.0
    for k in range(3):
        p, q = (k + 1) % 3, (k + 2) % 3
        area += (
            (points[1, p] - points[0, p]) * (points[2, q] - points[0, q])
            - (points[1, q] - points[0, q]) * (points[2, p] - points[0, p])
        ) ** 2
    return np.sqrt(area) / longest


@njit
def middle_and_inverse(points: Array, middle: Array, inverse: Array) -> None:
    """Write the middle (3,) m of points (N, 3), and the inverse of M = sum |r|^2 I - r r^T, r from there.

    With it the forces (M^-1 t) x r are the least that make a torque t, and M^-1 sum r x v is the turn nearest to
    velocities v.
    """
    n = points.shape[0]
    for k in range(3):
        middle[k] = 0.0
        for i in range(n):
            middle[k] += points[i, k] / n
    xx = yy = zz = xy = xz = yz = 0.0
    for i in range(n):
        x, y, z = points[i, 0] - middle[0], points[i, 1] - middle[1], points[i, 2] - middle[2]
        xx, yy, zz = xx + x * x, yy + y * y, zz + z * z
        xy, xz, yz = xy + x * y, xz + x * z, yz + y * z
    a, b, c, d, e, f = yy + zz, -xy, -xz, xx + zz, -yz, xx + yy
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    det = a * A + b * B + c * C
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = A / det, (a * f - c * c) / det, (a * d - b * b) / det
    inverse[0, 1] = inverse[1, 0] = B / det
    inverse[0, 2] = inverse[2, 0] = C / det
    inverse[1, 2] = inverse[2, 1] = (b * c - a * e) / det


@njit
def answers_to_pushes(contacts: Contacts, answers: Array, hold: Array) -> float:
    """Write the least forces that make up the weight, along each axis and against gravity; return the weight, N.

    About the contacts' middle forces and torques come apart: each contact takes its part of the force, and turns
    against the torque.

    Args:
        contacts: N, whose grasp matrix has rank 6.
        answers: (N, c, 3), written: contact, axis, axis of a force of one weight through the centre of mass.
        hold: (N, c), written: the forces whose sum bears the object.
    """
    n, c, g = answers.shape[0], answers.shape[1], contacts.gravity
    weight = np.sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2])
    _least_answers(
        contacts.points, contacts.normals, contacts.model.torsion, contacts.centre, weight, answers
    )
    for i in range(n):
        for k in range(c):
            hold[i, k] = (
                -(answers[i, k, 0] * g[0] + answers[i, k, 1] * g[1] + answers[i, k, 2] * g[2]) / weight
            )
    return weight


@njit
def _least_answers(
    points: Array, normals: Array, torsion: float | None, centre: Array, weight: float, answers: Array
) -> None:
    if torsion is None:
        _point_answers(points, centre, weight, answers)
    else:
        G = contact_map(points, normals, torsion, centre, 1.0)
        least = np.linalg.solve(G @ G.T, np.ascontiguousarray(np.eye(6)[:, :3]))
        answers[:] = (weight * (G.T @ least)).reshape(answers.shape)


@njit
def _point_answers(points: Array, centre: Array, weight: float, answers: Array) -> None:
    n, middle, inverse, turn = points.shape[0], np.empty(3), np.empty((3, 3)), np.empty(3)
    middle_and_inverse(points, middle, inverse)
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for k in range(3):  # arm x e has arm_v along u and -arm_u along v
            turn[k] = inverse[k, u] * (centre[v] - middle[v]) - inverse[k, v] * (centre[u] - middle[u])
        for i in range(n):
            r = points[i]
            for k in range(3):
                p, q = (k + 1) % 3, (k + 2) % 3
                answers[i, k, axis] = weight * (turn[p] * (r[q] - middle[q]) - turn[q] * (r[p] - middle[p]))
            answers[i, axis, axis] += weight / n


def rms_radius(points: Array) -> float:
    """Return the root mean square distance of points (N, 3) from their centroid; 1.0 where they all coincide."""
    radius = float(np.sqrt(((points - points.mean(0)) ** 2).sum(-1).mean()))
    return radius if radius > 1e-12 else 1.0
