"""Viewpoint of a cloud that one camera saw, found by the shadows on its table, and what is hidden from there."""

from typing import NamedTuple

import numpy as np

from dexgrasp_env.arrays import Array, Index, Mask, unit
from dexgrasp_env.perception.hulls import beyond, hull_of

_SQUARE, _AROUND = 0.008, 0.25  # m, side of squares of the table that are seen or in shadow; m around things
_HALF = 120  # pixels, of 5 mm at the things, half the side of an image of them


def find_viewpoint(above: Array, table: Array) -> Array | None:
    """Return where the camera was (3,) m, or None where no one place explains what of the table was not seen.

    Azimuth, elevation and distance are searched one after the other, twice.

    Args:
        above: (N, 3) m, what stands on the table z = 0.
        table: (M, 3) m, what was seen of that.
    """
    from scipy.ndimage import binary_closing

    low, high = above[:, :2].min(0) - _AROUND, above[:, :2].max(0) + _AROUND
    shape = np.ceil((high - low) / _SQUARE).astype(int)
    most = 3000  # points that throw shadows
    points = above[:: max(1, len(above) // most)]
    middle, outline = points.mean(0), hull_of(table[:: max(1, len(table) // most), :2])
    if outline is None:
        return None

    def drawn(flat: Array) -> Mask:
        """Return the squares of the table that points (N, 2) m cover, small holes closed."""
        image = np.histogramdd(flat, shape.tolist(), list(zip(low, low + _SQUARE * shape, strict=True)))[0]
        return np.asarray(binary_closing(image > 0.0, iterations=2))

    def place(angle: float, rise: float, far: float) -> Array:
        """Return the place (3,) m of a camera, in spherical coordinates about the middle of the points."""
        return middle + far * np.array(
            [np.cos(rise) * np.cos(angle), np.cos(rise) * np.sin(angle), np.sin(rise)]
        )

    def shadow(angle: float, rise: float, far: float) -> Mask:
        """Return the squares of the table that a camera there would not see."""
        eye = place(angle, rise, far)
        down = points[:, 2:] / np.maximum(eye[2] - points[:, 2:], 1e-3)
        return drawn(points[:, :2] + down * (points[:, :2] - eye[:2])) & of_table

    def explained(*tried: float) -> float:
        """Return the overlap of what is unseen of the table and the shadows that a camera there would see."""
        dark = shadow(*tried)
        return float((dark & unseen).sum() / max((dark | unseen).sum(), 1))

    squares = low + _SQUARE * (np.indices(shape).reshape(2, -1).T + 0.5)
    of_table = (beyond(outline, squares) < 0.0).reshape(shape)
    unseen = of_table & ~drawn(table[:, :2])
    azimuths, rises = np.radians(np.arange(0.0, 360.0, 15.0)), np.radians(np.arange(18.0, 84.0, 8.0))
    best = [0.0, np.radians(42.0), 0.8]
    for axis, tried in ((0, azimuths), (1, rises), (2, (0.5, 0.8, 1.3)), (0, azimuths), (1, rises)):
        ways = ([*best[:axis], value, *best[axis + 1 :]] for value in tried)
        best = max(ways, key=lambda way: explained(*way))
    # Where several cameras saw the cloud, most of what one does not see was seen.
    thrown = unseen[shadow(*best) & ~drawn(points[:, :2])]
    return place(*best) if thrown.sum() > max(15, 0.6 * len(thrown)) else None


class View(NamedTuple):
    """Image of what one camera saw, its pixels 5 mm wide at the things.

    Attributes:
        eye: (3,) m, where the camera was.
        axes: (3, 3) right and down, in pixels, and forward.
        depth: (H, H) m of the nearest point in each pixel, infinity without a ray.
    """

    eye: Array
    axes: Array
    depth: Array

    @classmethod
    def of(cls, points: Array, things: Array, eye: Array) -> "View":
        """Return the view of points (N, 3) m, centred on those of things (M, 3) m."""
        rays = things - eye
        forward = unit(rays.mean(0))
        right = unit(np.cross(forward, [0.0, 0.0, 1.0]))
        scale = np.median(np.linalg.norm(rays, axis=1)) / 0.005
        axes = np.stack([scale * right, scale * np.cross(right, forward), forward])
        view = cls(eye, axes, np.full((2 * _HALF, 2 * _HALF), np.inf))
        pixels, far, _ = view.pixels(points)
        np.minimum.at(view.depth, pixels, far)
        return view

    def pixels(self, points: Array) -> tuple[tuple[Index, Index], Array, Index]:
        """Return the pixels of those of points (N, 3) m that are in the image, how far they are, m, and which."""
        rays = points - self.eye
        x, y, forward = self.axes @ rays.T
        u, v = np.floor(np.stack([x, y]) / forward).astype(int) + _HALF
        rows = np.flatnonzero((np.minimum(u, v) > 0) & (np.maximum(u, v) < 2 * _HALF))
        return (u[rows], v[rows]), np.linalg.norm(rays[rows], axis=1), rows

    def separates(self, one: Array, two: Array) -> bool:
        """Return true where a ray passes between points (N, 3) m and others (M, 3) m, there where they are close."""
        from scipy.spatial import cKDTree

        gaps, other = cKDTree(two).query(one)
        close = gaps < gaps.min() + 0.01  # m
        ways = np.linspace(0.15, 0.85, 8)[:, None, None]
        pixels, far, _ = self.pixels((one[close] + ways * (two[other] - one)[close]).reshape(-1, 3))
        behind = self.depth[pixels] - far  # m
        return bool(((behind > 0.01) & (behind < np.inf)).mean() > 0.05)


def hidden_in_part(view: View, points: Array, labels: Index) -> set[int]:
    """Return the things that others stand in front of, with no ray that passes between.

    Args:
        view: of all that was seen.
        points: (N, 3) m, those of it that are above the table.
        labels: (N,) of the thing that each is of, -1 for what is none.
    """
    nothing = -2  # in a pixel without a ray
    thing = np.where(view.depth < np.inf, -1, nothing)
    pixels, far, rows = view.pixels(points)
    nearest = far < view.depth[pixels] + 1e-6
    thing[pixels[0][nearest], pixels[1][nearest]] = labels[rows[nearest]]
    hidden = np.zeros_like(thing, bool)
    for axis, way in ((0, 1), (0, -1), (1, 1), (1, -1)):
        blind = thing >= 0
        for step in range(way, 9 * way, way):
            other = np.roll(thing, step, axis)
            met = blind & (other >= 0) & (other != thing)
            hidden |= met & (view.depth > np.roll(view.depth, step, axis) + 0.01)
            blind &= (other == nothing) | (other == thing)
    return set(np.flatnonzero(np.bincount(thing[hidden], minlength=1) >= 8).tolist())
