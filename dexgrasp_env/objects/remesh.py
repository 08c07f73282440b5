"""A broken surface rebuilt as the surface of the cells that its skin encloses."""

from __future__ import annotations

import numpy as np
import trimesh

from dexgrasp_env.arrays import Array
from dexgrasp_env.objects.shapes import from_manifold
from dexgrasp_env.objects.surface import is_solid, simplified

GRID = 64
"""Cells along the longest side."""
MOST_FACES = 20_000


def remeshed(mesh: trimesh.Trimesh) -> trimesh.Trimesh | None:
    """Surface of the cells that the skin encloses, or None where the skin encloses nothing."""
    inside, origin, pitch = _filled_grid(mesh)
    if inside.sum() < 8:
        return None
    solid = _level_surface(inside, origin, pitch)
    return solid if is_solid(solid) else None


def _filled_grid(mesh: trimesh.Trimesh) -> tuple[np.ndarray, Array, float]:
    """Cells inside the skin, closed over small gaps; the lowest corner of the grid; the side of a cell."""
    from scipy import ndimage

    pitch = float(mesh.extents.max()) / GRID
    points = mesh.sample(int(min(40 * mesh.area / pitch**2, 2e6)), seed=0)
    origin = mesh.bounds[0] - 4.5 * pitch
    shape = np.ceil((mesh.extents + 9 * pitch) / pitch).astype(int)
    skin = np.zeros(shape, dtype=bool)
    skin[tuple(((points - origin) / pitch).astype(int).T)] = True
    thick = ndimage.binary_dilation(skin, iterations=2)
    filled = ndimage.binary_erosion(ndimage.binary_fill_holes(thick), iterations=2)
    return filled & ~(skin & ~ndimage.binary_erosion(filled)), origin, pitch


def _level_surface(inside: np.ndarray, origin: Array, pitch: float) -> trimesh.Trimesh:
    """Smooth surface half a cell outside the cells `inside`."""
    import manifold3d
    from scipy import ndimage

    depth = ndimage.distance_transform_edt(inside) - ndimage.distance_transform_edt(~inside)
    depth = ndimage.gaussian_filter(depth.astype(float), 0.7) + 0.5

    cells, (_, rows, columns) = (
        depth.ravel().tolist(),
        depth.shape,
    )  # Python's floats: it is called 100,000 times
    (ox, oy, oz), (nx, ny, nz) = origin.tolist(), (side - 2 for side in depth.shape)

    def level(x: float, y: float, z: float) -> float:
        u, v, w = (x - ox) / pitch - 0.5, (y - oy) / pitch - 0.5, (z - oz) / pitch - 0.5
        i, j, k = min(max(int(u), 0), nx), min(max(int(v), 0), ny), min(max(int(w), 0), nz)
        u, v, w = min(max(u - i, 0.0), 1.0), min(max(v - j, 0.0), 1.0), min(max(w - k, 0.0), 1.0)
        corner = (i * rows + j) * columns + k
        lines = (
            cells[at] * (1 - w) + cells[at + 1] * w
            for at in (corner, corner + columns, corner + rows * columns, corner + (rows + 1) * columns)
        )
        a, b, c, d = lines
        return float((a * (1 - v) + b * v) * (1 - u) + (c * (1 - v) + d * v) * u)

    high = origin + pitch * np.array(inside.shape)
    solid = manifold3d.Manifold.level_set(level, [*origin, *high], 1.5 * pitch)
    largest = max(solid.decompose(), key=lambda piece: piece.volume(), default=solid)
    surface = from_manifold(largest)
    return simplified(surface, MOST_FACES) if len(surface.faces) > MOST_FACES else surface
