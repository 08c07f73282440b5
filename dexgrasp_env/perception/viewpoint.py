"""Viewpoint of a cloud that one camera saw, found by the shadows on its table, and what is hidden from there."""

import numpy as np

from dexgrasp_env.arrays import Array, Index, Mask, unit

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
    from scipy.spatial import Delaunay, QhullError

    low, high = above[:, :2].min(0) - _AROUND, above[:, :2].max(0) + _AROUND
    shape = np.ceil((high - low) / _SQUARE).astype(int)
    most = 3000  # points that throw shadows
    points = above[:: max(1, len(above) // most)]
    middle, top = points.mean(0), points[:, 2].max()

    def drawn(flat: Array) -> Mask:
        """Return the squares of the table that points (N, 2) m cover, small holes closed."""
        image = np.zeros(shape, bool)
        squares = np.floor((flat - low) / _SQUARE).astype(int)
        image[tuple(squares[((squares >= 0) & (squares < shape)).all(1)].T)] = True
        return np.asarray(binary_closing(image, iterations=2))

    def place(angle: float, rise: float, far: float) -> Array:
        """Return the place (3,) m of a camera, in spherical coordinates about the middle of the points."""
        return middle + far * np.array(
            [np.cos(rise) * np.cos(angle), np.cos(rise) * np.sin(angle), np.sin(rise)]
        )

    def explained(*tried: float) -> float:
        """Return the overlap of what is unseen of the table and the shadows that a camera there would see."""
        eye = place(*tried)
        down = points[:, 2:] / np.maximum(eye[2] - points[:, 2:], 1e-3)
        shadow = drawn(points[:, :2] + down * (points[:, :2] - eye[:2])) & of_table
        return float((shadow & unseen).sum() / max((shadow | unseen).sum(), 1)) * (eye[2] > top)

    try:
        outline = Delaunay(table[:: max(1, len(table) // most), :2])
    except (QhullError, ValueError):
        return None
    squares = low + _SQUARE * (np.indices(shape).reshape(2, -1).T + 0.5)
    of_table = (outline.find_simplex(squares) >= 0).reshape(shape)
    unseen = of_table & ~drawn(table[:, :2])
    azimuths, rises = np.radians(np.arange(0.0, 360.0, 15.0)), np.radians(np.arange(18.0, 84.0, 8.0))
    best = [0.0, np.radians(42.0), 0.8]
    for axis, tried in ((0, azimuths), (1, rises), (2, (0.5, 0.8, 1.3)), (0, azimuths), (1, rises)):
        ways = ([*best[:axis], value, *best[axis + 1 :]] for value in tried)
        best = max(ways, key=lambda way: explained(*way))
    return place(*best) if explained(*best) > 0.45 else None  # of shadow and of what was not seen is both


def hidden_in_part(points: Array, labels: Index, eye: Array) -> set[int]:
    """Return the things that others stand in front of, seen from `eye` (3,) m, with no ray that passes between.

    Args:
        points: (N, 3) m, all that was seen.
        labels: (N,) of the thing that each is of, -1 for what is none, as the table.
        eye: where the camera was.
    """
    rays = points - eye
    far = np.linalg.norm(rays, axis=1)
    forward = unit(rays[labels >= 0].mean(0))
    right = unit(np.cross(forward, [0.0, 0.0, 1.0]))
    flat = np.stack([rays @ right, rays @ np.cross(right, forward)], axis=1) / (rays @ forward)[:, None]
    pixels = np.floor(flat * np.median(far[labels >= 0]) / 0.005).astype(int)
    near = (np.abs(pixels) < _HALF).all(1)
    order = np.argsort(-far[near])  # what is nearer comes last, and stays
    where = tuple(pixels[near][order].T + _HALF)
    nothing = -2  # in a pixel without a ray
    depth, thing = np.full((2 * _HALF, 2 * _HALF), np.inf), np.full((2 * _HALF, 2 * _HALF), nothing)
    depth[where], thing[where] = far[near][order], labels[near][order]
    hidden = np.zeros_like(thing, bool)
    for axis, way in ((0, 1), (0, -1), (1, 1), (1, -1)):
        blind = thing >= 0
        for step in range(way, 9 * way, way):
            other = np.roll(thing, step, axis)
            met = blind & (other >= 0) & (other != thing)
            hidden |= met & (depth > np.roll(depth, step, axis) + 0.01)
            blind &= (other == nothing) | (other == thing)
    return set(np.flatnonzero(np.bincount(thing[hidden], minlength=1) >= 8).tolist())
