"""A calibrated depth camera as data: intrinsics and mounting.

The camera frame is the optical frame of OpenCV: x right, y down, z forward along the optical axis. Pixel
(u, v) has its centre at u, v; the image of a point (x, y, z) is u = fx x / z + cx, v = fy y / z + cy.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import rigid


@dataclass(frozen=True)
class CameraIntrinsics:
    """A pinhole camera without distortion: image size and focal lengths in pixels."""

    width: int = 160
    height: int = 120
    fx: float = 172.0
    fy: float = 172.0
    cx: float = 79.5
    cy: float = 59.5

    def __post_init__(self) -> None:
        if not (min(self.width, self.height) >= 8 and self.width * self.height <= 1 << 24):
            raise InputError(
                f"camera image {self.width} x {self.height}: valid are 8 x 8 pixels and more, 16 million at most"
            )
        if not (self.fx > 0 and self.fy > 0):
            raise InputError(f"focal lengths must be positive: got fx = {self.fx}, fy = {self.fy}")

    @classmethod
    def from_fovy(cls, fovy: float, width: int = 160, height: int = 120) -> "CameraIntrinsics":
        """Return square pixels and a centred principal point for a vertical field of view in degrees."""
        if not 1.0 <= fovy <= 170.0:
            raise InputError(f"fovy {fovy} is out of range: valid are 1 to 170 degrees")
        focal = 0.5 * height / np.tan(np.radians(0.5 * fovy))
        return cls(width, height, focal, focal, 0.5 * (width - 1), 0.5 * (height - 1))

    @property
    def fovy(self) -> float:
        """Vertical field of view, degrees."""
        return float(np.degrees(2.0 * np.arctan(0.5 * self.height / self.fy)))

    def directions(self) -> Array:
        """Rays of the pixels in the optical frame, (H, W, 3), scaled to z = 1: a point is depth times ray."""
        u, v = np.meshgrid(
            (np.arange(self.width) - self.cx) / self.fx, (np.arange(self.height) - self.cy) / self.fy
        )
        return np.stack([u, v, np.ones_like(u)], axis=-1)


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera and its pose.

    Attributes:
        name: of the MJCF camera.
        T_world_camera: (4, 4) pose of the optical frame in the world frame, metres.
        intrinsics: the pinhole model.
    """

    name: str
    T_world_camera: Array
    intrinsics: CameraIntrinsics = field(default_factory=CameraIntrinsics)

    def __post_init__(self) -> None:
        T = np.asarray(self.T_world_camera, dtype=float)
        if T.shape != (4, 4) or not np.isfinite(T).all():
            raise InputError(
                f"camera {self.name!r}: T_world_camera must be a finite 4 x 4 matrix, got shape {T.shape}"
            )
        if not np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-6) or np.linalg.det(T[:3, :3]) < 0:
            raise InputError(
                f"camera {self.name!r}: the rotation of T_world_camera must be orthonormal and right-handed"
            )
        object.__setattr__(self, "T_world_camera", T)

    @classmethod
    def look_at(
        cls, name: str, position: ArrayLike, target: ArrayLike, intrinsics: CameraIntrinsics | None = None
    ) -> "Camera":
        """Return a camera at `position` looking at `target`, rows level; both (3,) m, world frame."""
        eye = np.array(position, dtype=float)
        forward = np.array(target, dtype=float) - eye
        if np.linalg.norm(forward) < 1e-6:
            raise InputError(f"camera {name!r}: position and target coincide")
        forward /= np.linalg.norm(forward)
        up = [0.0, 0.0, 1.0] if abs(forward[2]) < 0.999 else [1.0, 0.0, 0.0]
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        T = rigid(np.stack([right, np.cross(forward, right), forward], axis=1), eye)
        return cls(name, T, intrinsics or CameraIntrinsics())

    @property
    def position(self) -> Array:
        """Optical centre in the world frame, (3,) m."""
        return self.T_world_camera[:3, 3]

    @property
    def rotation(self) -> Array:
        """(3, 3) rotation of the optical frame in the world frame."""
        return self.T_world_camera[:3, :3]

    def moved(self, T_camera_believed: Array) -> "Camera":
        """Return the camera with its pose multiplied on the right by a (4, 4) transform."""
        return replace(self, T_world_camera=self.T_world_camera @ T_camera_believed)
