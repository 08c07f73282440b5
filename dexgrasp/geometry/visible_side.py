"""The side of an object that was seen, as numbers in a frame of its own: what the completion network reads.

All of it is support functions: h(d) = max d . x over the points, for fixed directions d.
"""

from typing import NamedTuple

import numpy as np

from dexgrasp_env.arrays import Array, middle
from dexgrasp_env.perception.plane import Plane

UNIT = 0.1
"""m: lengths are read and written in this unit."""
ONE_SIDED = 0.4
"""From here on normals point one way: with four cameras up to 0.27 was measured, with one the median is 0.86."""


def one_sidedness(normals: Array) -> float:
    """Return |sum| / sum || of the level parts of normals (N, 3): near 0 seen all round, near 1 from one side."""
    level = normals[:, :2]
    return float(np.linalg.norm(level.sum(0)) / max(float(np.linalg.norm(level, axis=1).sum()), 1e-9))


def even_directions(azimuths: int, elevations: tuple[float, ...]) -> Array:
    """Return unit directions (N, 3): rings of evenly spaced azimuths at elevations in degrees, and straight up."""
    azimuth, elevation = np.meshgrid(2.0 * np.pi * np.arange(azimuths) / azimuths, np.radians(elevations))
    level = np.cos(elevation)
    rings = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)
    return np.concatenate([rings.reshape(-1, 3), [[0.0, 0.0, 1.0]]])


READ = even_directions(24, (-35.0, 0.0, 25.0, 55.0))
"""(97, 3) directions in which the seen side is read."""
WRITTEN = even_directions(40, (-50.0, -25.0, -10.0, 0.0, 10.0, 20.0, 30.0, 45.0, 65.0))
"""(361, 3) directions in which the whole object is written."""


class VisibleSide(NamedTuple):
    """Points and normals in the frame of the view: origin on the table amid the points, z up, x along a face.

    x is the level direction, within 45 degrees of the viewer's, that normals favour up to quarter turns: the walls of a
    box then lie exactly in directions that are read and written.
    """

    points: Array  # (N, 3) UNIT
    normals: Array  # (N, 3)
    R: Array  # (3, 3) rotation, world frame to that of the view
    origin: Array  # (3,) m, world frame
    viewer: float  # rad, where the normals point on the whole, from x

    @classmethod
    def of(cls, points: Array, normals: Array, plane: Plane) -> "VisibleSide":
        """Look at points (N, 3) m with outward normals (N, 3), both in the world frame."""
        level = normals[:, :2]
        length = np.linalg.norm(level, axis=1)
        viewer = np.arctan2(level[:, 1].sum(), level[:, 0].sum())
        turn = (level[:, 0] + 1j * level[:, 1]) / np.maximum(length, 1e-9)
        face = np.angle((length**2 * turn**4).sum()) / 4.0
        face += np.round((viewer - face) / (np.pi / 2.0)) * np.pi / 2.0
        c, s = np.cos(face), np.sin(face)
        R = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        amid = middle(points)
        origin = amid - plane.heights(amid) * plane.normal
        return cls((points - origin) @ R.T / UNIT, normals @ R.T, R, origin, float(viewer - face))

    def features(self) -> Array:
        """Return what the network reads, (391,)."""
        along = self.points @ READ.T
        most = along.max(0)
        below = most - np.quantile(along, (0.9, 0.5), axis=0)
        # how narrowly a direction looks at normals: half at 23 degrees
        facing = (np.maximum(self.normals @ READ.T, 0.0) ** 8).mean(0)
        rest = [np.cos(self.viewer), np.sin(self.viewer), np.log(len(self.points)) / 5.0]
        return np.concatenate([most, *below, facing, rest])

    def seen(self) -> Array:
        """Return the support (361,) of the seen side in the directions `WRITTEN`, UNIT."""
        return (self.points @ WRITTEN.T).max(0)
