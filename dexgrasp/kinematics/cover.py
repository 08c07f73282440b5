"""Spheres that cover the robot's collision shapes from outside."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array

_COLLISION_GROUP = 3
_LARGEST_CELL = 0.03  # m: half the cell that one sphere covers


@dataclass(frozen=True)
class Spheres:
    """Spheres of one body, in its frame: centres (n, 3) m, radii (n,) m, and whether each covers a grasping tip."""

    centre: Array
    radius: Array
    is_tip: NDArray[np.bool_]

    def bound(self) -> tuple[Array, float]:
        """Return centre (3,) and radius of a sphere around all; radius -1 if there are none."""
        if not len(self.radius):
            return np.zeros(3), -1.0
        centre = 0.5 * (self.centre.min(0) + self.centre.max(0))
        return centre, float((np.linalg.norm(self.centre - centre, axis=1) + self.radius).max())


def body_spheres(model: mujoco.MjModel, body: int, touching: tuple[str, ...]) -> Spheres:
    """Cover the collision geoms (boxes, capsules, spheres, cylinders) of a body; what `touching` names may touch."""
    centres, radii, tips = [np.zeros((0, 3))], [np.zeros(0)], [np.zeros(0, bool)]
    for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
        if model.geom_group[geom] != _COLLISION_GROUP:
            continue
        local, radius = _cover(model, geom)
        centres.append(local @ rotation_matrix(model.geom_quat[geom]).T + model.geom_pos[geom])
        radii.append(np.full(len(local), radius))
        tips.append(np.full(len(local), model.geom(geom).name in touching))
    return Spheres(np.concatenate(centres), np.concatenate(radii), np.concatenate(tips))


def rotation_matrix(quat: Array) -> Array:
    """Return the rotation (3, 3) of a quaternion wxyz, as the simulation computes it."""
    out = np.zeros(9)
    mujoco.mju_quat2Mat(out, quat)
    return out.reshape(3, 3)


def _cover(model: mujoco.MjModel, geom: int) -> tuple[Array, float]:
    kind, size = model.geom_type[geom], model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.zeros((1, 3)), float(size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return _along_axis(size[1], size[0])
    half = size.copy()
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        half = np.array([size[0], size[0], size[1]])
    return _cells(half)


def _along_axis(half_length: float, radius: float) -> tuple[Array, float]:
    """Spheres on a capsule's axis, close enough that the inflated radius exceeds the true one by under 0.5 mm."""
    spacing = 2.0 * np.sqrt((radius + 0.0005) ** 2 - radius**2)
    count = max(2, int(np.ceil(2.0 * half_length / spacing)) + 1)
    z = np.linspace(-half_length, half_length, count)
    step = z[1] - z[0]
    inflated = float(np.hypot(radius, 0.5 * step))
    return np.stack([0 * z, 0 * z, z], axis=1), inflated


def _cells(half: Array) -> tuple[Array, float]:
    """Divide a box into cells half as long as it is thin; each sphere goes around its cell.

    A finger link (9.8 mm half thickness) is then exceeded by 3 mm at most, the palm by 7 mm.
    """
    cell = min(0.5 * half.min(), _LARGEST_CELL)
    counts = np.maximum(1, np.ceil(half / (1.05 * cell))).astype(int)
    step = 2.0 * half / counts
    axes = [np.linspace(-h + 0.5 * s, h - 0.5 * s, n) for h, s, n in zip(half, step, counts, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return grid, float(0.5 * np.linalg.norm(step))


def box_edges(centre: Array, half: Array, spacing: float = 0.0015) -> Array:
    """Return points (n, 3) m along the twelve edges of an axis-aligned box, at most `spacing` apart."""
    points = []
    for axis in range(3):
        count = int(np.ceil(2.0 * half[axis] / spacing)) + 1
        along = np.linspace(-half[axis], half[axis], count)
        for u in (-1, 1):
            for v in (-1, 1):
                edge = np.empty((count, 3))
                edge[:, axis], edge[:, (axis + 1) % 3], edge[:, (axis + 2) % 3] = (
                    along, u * half[(axis + 1) % 3], v * half[(axis + 2) % 3],
                )  # fmt: skip
                points.append(edge)
    return np.concatenate(points) + centre
