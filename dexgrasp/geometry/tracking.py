"""Pose of a rigid object that moves on a table, followed by the clouds that are seen of it."""

from collections import deque

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import about_z, rigid


class PlanarTracker:
    """Follows an object from the cloud of its first look on.

    A pose is (3,): shift m along x and y of the first cloud's middle, and turn rad about the vertical through it.

    Attributes:
        pose: at the last look.
        poses: at the last looks.
        velocity: (3,) m/s and rad/s.
        unevenness: (3,) m and rad, by which the last poses are off those at this velocity.
    """

    def __init__(self, points: Array, seconds: float) -> None:
        """Take the cloud (N, 3) m that the others are compared with."""
        self._tree, self._middle = cKDTree(points), points[:, :2].mean(0)
        self._flat = self._plane(points)
        self.pose, self.velocity = np.zeros(3), np.zeros(3)
        looks = 5  # of a velocity
        self._times, self.poses = deque([seconds], looks), deque([self.pose], looks)
        self.unevenness = np.full(3, np.inf)

    def see(self, points: Array, seconds: float) -> bool:
        """Update the pose by a cloud (N, 3) m; return False where that is not of the object, or too little of it."""
        if len(points) < 30:
            return False
        points = points[:: -(-len(points) // 400)]  # so many points are enough
        shift = points[:, :2].mean(0) - self._middle
        starts = [self.pose, self.at(seconds), np.append(shift, self.pose[2])]
        fits = [self._fit(points, start) for start in starts]
        fits_within = 0.004  # m, mean distance of a fit that is one
        if min(error for _, error in fits) > fits_within:
            # The object is not where it was going: it may have turned.
            turns = np.radians([-60, -40, -20, 20, 40, 60])
            fits += [self._fit(points, np.append(shift, self.pose[2] + turn)) for turn in turns]
        # A fit has to be 0.3 mm better than that at the last pose: what is round does not turn.
        k = min(range(len(fits)), key=lambda k: fits[k][1] + 3e-4 * (k > 0))
        pose, error = fits[k]
        if error > 2.0 * fits_within:
            return False
        self.pose = pose
        self._times.append(seconds)
        self.poses.append(pose)
        times, poses = np.array(self._times) - np.mean(self._times), np.array(self.poses)
        self.velocity = times @ poses / (times @ times)
        self.unevenness = np.abs(poses - poses.mean(0) - times[:, None] * self.velocity).max(0)
        return True

    def at(self, seconds: float) -> Array:
        """Return the pose (3,) at a time, at the velocity it has."""
        return self.pose + (seconds - self._times[-1]) * self.velocity

    def matrix(self, pose: Array) -> Array:
        """Return a pose as what moves points (4, 4)."""
        T = rigid(about_z(pose[2]), np.zeros(3))
        T[:2, 3] = self._middle + pose[:2] - T[:2, :2] @ self._middle
        return T

    def _fit(self, points: Array, pose: Array) -> tuple[Array, float]:
        """Return the pose next to one by iterated closest points, and the mean distance of those that count, m."""
        error = np.inf
        for _ in range(30):
            T = self.matrix(pose)
            distance, near = self._tree.query((points - T[:3, 3]) @ T[:3, :3])
            # The nearest 80 % of the points: others are of sides that were hidden, or of the hand.
            kept = distance <= np.quantile(distance, 0.8)
            error = float(distance[kept].mean())
            model, seen = self._flat[near[kept]], self._plane(points[kept])
            turn = np.angle(np.vdot(model - model.mean(), seen - seen.mean()))
            shift = seen.mean() - np.exp(1j * turn) * model.mean()
            before, pose = pose, np.array([shift.real, shift.imag, np.unwrap([pose[2], turn])[1]])
            if np.abs(pose - before).max() < 1e-5:  # m and rad
                break
        return pose, error

    def _plane(self, points: Array) -> NDArray[np.complex128]:
        """Return points (N, 3) m as seen from above, x + iy from the middle."""
        return points[:, 0] - self._middle[0] + 1j * (points[:, 1] - self._middle[1])
