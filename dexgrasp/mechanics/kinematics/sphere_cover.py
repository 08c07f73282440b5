"""Spheres that cover the robot's collision shapes from outside."""

from collections.abc import Iterable
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial import ConvexHull

from dexgrasp_env.arrays import Array, Mask, grid, middle
from dexgrasp_env.robot.hulls import mesh_of


class Spheres(NamedTuple):
    """Spheres of one body, in its frame: centres (n, 3) m, radii (n,) m, and whether each covers a grasping tip."""

    centre: Array
    radius: Array
    is_tip: Mask

    def bound(self) -> tuple[Array, float]:
        """Return centre (3,) and radius of a sphere around all; radius -1 if there are none."""
        if not len(self.radius):
            return np.zeros(3), -1.0
        centre = middle(self.centre)
        return centre, float((np.linalg.norm(self.centre - centre, axis=1) + self.radius).max())


def together(spheres: Iterable[Spheres]) -> Spheres:
    """Return the spheres of all in one."""
    return Spheres(*map(np.concatenate, zip(*spheres, strict=True)))


def body_spheres(model: mujoco.MjModel, body: int, touching: tuple[str, ...]) -> Spheres:
    """Cover the collision geoms (primitives and convex meshes) of a body; what `touching` names may touch."""
    found = [Spheres(np.zeros((0, 3)), np.zeros(0), np.zeros(0, bool))]
    for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
        if model.geom_group[geom] != 3:  # only seen
            continue
        is_tip, R = model.geom(geom).name in touching, rotation_matrix(model.geom_quat[geom])
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            corners = mesh_of(model, geom)[0].astype(float) @ R.T + model.geom_pos[geom]
            # m: cells are no smaller
            cell = 0.0045 if is_tip else max(0.006, 0.35 * float(np.ptp(corners, axis=0).min()))
            placed, radius = hull_cells(corners, cell)
        else:
            local, equal = _cover(model, geom)
            placed, radius = local @ R.T + model.geom_pos[geom], np.full(len(local), equal)
        found.append(Spheres(placed, radius, np.full(len(placed), is_tip)))
    return together(found)


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
    return _cells(size[[0, 0, 1]] if kind == mujoco.mjtGeom.mjGEOM_CYLINDER else size)


def _along_axis(half_length: float, radius: float) -> tuple[Array, float]:
    """Spheres on a capsule's axis, close enough that the inflated radius exceeds the true one by under 0.5 mm."""
    spacing = 2.0 * np.sqrt((radius + 0.0005) ** 2 - radius**2)
    count = max(2, int(np.ceil(2.0 * half_length / spacing)) + 1)
    z = np.linspace(-half_length, half_length, count)
    return np.stack([0 * z, 0 * z, z], axis=1), float(np.hypot(radius, 0.5 * (z[1] - z[0])))


def _cells(half: Array) -> tuple[Array, float]:
    """Divide a box into cells half as long as it is thin; each sphere goes around its cell.

    A finger link (9.8 mm half thickness) is then exceeded by 3 mm at most, the palm by 7 mm.
    """
    cell = min(0.5 * half.min(), 0.03)  # m: half the cell that one sphere covers
    # of a box: of one that is thin as a sheet they are as large as that takes
    while (counts := np.maximum(1.0, np.ceil(half / (1.05 * cell)))).prod() > 20_000:
        cell *= 2.0
    step = 2.0 * half / counts
    middles = map(np.linspace, 0.5 * step - half, half - 0.5 * step, counts.astype(int))
    return grid(*middles), float(0.5 * np.linalg.norm(step))


def hull_cells(corners: Array, cell: float) -> tuple[Array, Array]:
    """Divide the box around a convex hull; each sphere goes around what its cell has of the hull.

    Args:
        corners: (n, 3) m of the hull.
        cell: m, length of the cells.

    Returns:
        Centres (k, 3) and radii (k,) m, without cells deep inside.
    """
    low, size = corners.min(0), np.ptp(corners, axis=0)
    counts = np.ceil(6.0 * size / cell).astype(int) + 1
    points = low + grid(*map(np.linspace, np.zeros(3), size, counts))
    planes = ConvexHull(corners).equations
    outside = (points @ planes[:, :3].T + planes[:, 3]).max(1)
    # m at most from a point of the hull to one of the grid
    apart = 0.5 * float(np.linalg.norm(size / (counts - 1)))
    points, outside = points[outside < apart], outside[outside < apart]
    cells = np.maximum(1, np.ceil(size / cell)).astype(int)
    place = np.minimum(((points - low) / size * cells).astype(int), cells - 1)
    number = np.ravel_multi_index(tuple(place.T), tuple(cells))
    groups = [points[number == k] for k in np.unique(number) if outside[number == k].max() > -0.5 * cell]
    centres = np.array([middle(group) for group in groups])
    radii = [np.linalg.norm(g - c, axis=1).max() + apart for g, c in zip(groups, centres, strict=True)]
    return centres, np.array(radii)


def box_edges(centre: Array, half: Array) -> Array:
    """Return points (n, 3) m along the twelve edges of an axis-aligned box, at most 1.5 mm apart."""
    points = []
    for axis in range(3):
        # m between points of a box's edges
        along = np.linspace(-half[axis], half[axis], int(np.ceil(2.0 * half[axis] / 0.0015)) + 1)
        across = [(-side, side) for side in (half[axis - 2], half[axis - 1])]
        points.append(np.roll(grid(*across, along), axis + 1, axis=1))
    return np.concatenate(points) + centre
