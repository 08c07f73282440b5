"""Natural cubic splines: scipy's, without the half second that importing scipy.interpolate takes."""

import numpy as np
from scipy.linalg import solve_banded

from dexgrasp_env.arrays import Array


class NaturalSpline:
    """A cubic spline through points (n, d), n >= 3, at places (n,); the second derivative is 0 at both ends."""

    def __init__(self, at: Array, points: Array) -> None:
        """Prepare; places rise strictly."""
        step, width = np.diff(at), np.diff(at)[:, None]
        rise = np.diff(points, axis=0) / width
        bands, right = np.zeros((3, len(at))), np.empty(points.shape)
        bands[1, 1:-1] = 2 * (step[:-1] + step[1:])
        bands[0, 2:], bands[2, :-2] = step[:-1], step[1:]
        bands[1, 0], bands[0, 1], bands[1, -1], bands[2, -2] = 2 * step[0], step[0], 2 * step[-1], step[-1]
        right[1:-1] = 3 * (width[1:] * rise[:-1] + width[:-1] * rise[1:])
        right[0], right[-1] = 3 * (points[1] - points[0]), 3 * (points[-1] - points[-2])
        slope = solve_banded((1, 1), bands, right, overwrite_ab=True, overwrite_b=True, check_finite=False)
        bend = (slope[:-1] + slope[1:] - 2 * rise) / width
        self._at = at
        self._pieces = points[:-1], slope[:-1], (rise - slope[:-1]) / width - bend, bend / width

    def __call__(self, places: Array, derivative: int = 0) -> Array:
        """Return the spline (m, d) at places (m,), or its first or second derivative."""
        k = np.clip(np.searchsorted(self._at, places, side="right") - 1, 0, len(self._at) - 2)
        s = (places - self._at[k])[:, None]
        a, b, c, d = (piece[k] for piece in self._pieces)
        if derivative == 0:
            return np.asarray(a + b * s + c * (s * s) + d * (s * s * s))
        return np.asarray(b + c * s * 2.0 + d * (s * s) * 3.0 if derivative == 1 else c * 2.0 + d * s * 6.0)
