"""Quaternions (wxyz) and rotations on arrays with leading batch axes.

No BLAS: a batch of one and a batch of many give the same bits.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dexgrasp_env.arrays import Array

_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


def components(a: Array) -> Any:
    """Return the last axis first: of one vector (n,) a list of plain numbers, which are quick, of many a view."""
    a = np.asarray(a, dtype=float)
    return a.tolist() if a.ndim == 1 else np.moveaxis(a, -1, 0)


def join(*parts: Any) -> Array:
    """Return the components of vectors, all of one shape, along a new last axis."""
    if isinstance(parts[0], float):
        return np.array(parts)
    joined = np.empty((*parts[0].shape, len(parts)))
    for i, part in enumerate(parts):
        joined[..., i] = part
    return joined


def quat_multiply(a: Array, b: Array) -> Array:
    """Hamilton product of unit quaternions, (..., 4) wxyz."""
    return join(*product_components(components(a), components(b)))


def product_components(a: Any, b: Any) -> tuple[Any, ...]:
    """Return the four numbers of Hamilton products, from those of the factors."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def quat_conjugate(q: Array) -> Array:
    """Inverse of unit quaternions, (..., 4) wxyz."""
    return q * _CONJUGATE


def rotation_components(w: Any, x: Any, y: Any, z: Any) -> tuple[Any, ...]:
    """Return the nine numbers of rotation matrices, row by row, from those of unit quaternions."""
    return (
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


def quat_to_matrix(q: Array) -> Array:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4) wxyz."""
    flat = join(*rotation_components(*components(q)))
    return flat.reshape(*flat.shape[:-1], 3, 3)


def matrix_to_quat(R: Array) -> Array:
    """Unit quaternions (..., 4) wxyz, w >= 0, of rotation matrices (..., 3, 3)."""
    from scipy.spatial.transform import Rotation

    R = np.asarray(R, dtype=float)
    flat = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_quat(canonical=True, scalar_first=True)
    return flat.reshape(*R.shape[:-2], 4)


def frame_of_z(z: Array) -> Array:
    """Return a rotation matrix (3, 3) whose last column is a unit vector (3,)."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def rotate(q: Array, v: Array) -> Array:
    """Rotate vectors (..., 3) by unit quaternions (..., 4) wxyz."""
    return join(*rotated_components(components(q), components(v)))


def rotated_components(q: Any, v: Any) -> tuple[Any, ...]:
    """Return the three numbers of rotated vectors, from those of the quaternions and vectors."""
    w, x, y, z = q
    a, b, c = v
    tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return (
        a + w * tx + (y * tz - z * ty),
        b + w * ty + (z * tx - x * tz),
        c + w * tz + (x * ty - y * tx),
    )


def yaw_quat(yaw: Array | float) -> Array:
    """Quaternions (..., 4) wxyz of turns about z by `yaw` radians."""
    half = np.asarray(yaw, dtype=float) / 2.0
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)


def pose_matrix(position: Array, quat_wxyz: Array) -> Array:
    """Homogeneous transforms (..., 4, 4) of positions (..., 3) and unit quaternions (..., 4)."""
    T = np.zeros((*np.broadcast_shapes(position.shape[:-1], quat_wxyz.shape[:-1]), 4, 4))
    T[..., :3, :3] = quat_to_matrix(quat_wxyz)
    T[..., :3, 3] = position
    T[..., 3, 3] = 1.0
    return T


def rigid(R: Array, position: ArrayLike) -> Array:
    """Return the pose (4, 4) with a rotation matrix (3, 3) and a position (3,)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, position
    return T


def about_z(angle: Array | float) -> Array:
    """Return the matrices (..., 3, 3) of turns about z by `angle` (...) rad."""
    c, s = np.cos(angle), np.sin(angle)
    zero, one = np.zeros_like(c), np.ones_like(c)
    return np.moveaxis(np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]]), (0, 1), (-2, -1))


def least_turn(start: Array, end: Array) -> Array:
    """Return the rotation matrix (3, 3) of the smallest turn that takes a unit vector (3,) to another (Rodrigues)."""
    x, y, z = np.cross(start, end)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + K + K @ K / (1.0 + start @ end))


def shifted(T: Array, offset: Array) -> Array:
    """Return a pose (4, 4) moved by `offset` (3,) m."""
    moved = T.copy()
    moved[:3, 3] += offset
    return moved


def inverse(T: Array) -> Array:
    """Return the inverse of a pose (4, 4)."""
    R = T[:3, :3].T
    return rigid(R, 0.0 - R @ T[:3, 3])


def placed(T: Array, points: Array) -> Array:
    """Return points (..., 3) m of one frame in another, in which the first has pose `T` (4, 4)."""
    return points @ T[:3, :3].T + T[:3, 3]
