"""One rigid error that all cameras share: the cell's calibration, a little off."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.random import Generator

from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import quat_to_matrix, rigid
from dexgrasp_env.robot.camera import Camera
from dexgrasp_env.valid import number

PIVOT = (0.5, 0.0, 0.0)  # m, world frame: the error turns about axes through this point


@dataclass(frozen=True)
class Calibration:
    """Size of the error, of which the directions are drawn at each reset; none at zero.

    Attributes:
        position: m, in a random direction.
        rotation: rad, about a random axis through (0.5, 0, 0).
    """

    position: Annotated[float, number(ge=0, le=0.5)] = 0.0
    rotation: Annotated[float, number(ge=0, le=0.5)] = 0.0

    def misplace(self, cameras: tuple[Camera, ...], rng: Generator) -> tuple[Camera, ...]:
        """Return the cameras where a calibration with this error believes them to be; draws only if there is one."""
        if self == Calibration():
            return cameras
        T = self._error(rng)
        return tuple(Camera(c.name, T @ c.T_world_camera, c.intrinsics) for c in cameras)

    def _error(self, rng: Generator) -> Array:
        """Return a rigid motion (4, 4) of the drawn directions."""
        shift, axis = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
        half = 0.5 * self.rotation
        R = quat_to_matrix(np.array([np.cos(half), *(np.sin(half) * axis)]))
        return rigid(R, np.array(PIVOT) - R @ PIVOT + self.position * shift)
