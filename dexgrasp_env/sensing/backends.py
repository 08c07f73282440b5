"""One interface to depth images, whatever computes them."""

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.robot.camera import Camera
from dexgrasp_env.sensing.groups import VISUAL_GROUPS

if TYPE_CHECKING:
    import mujoco

BACKENDS = ("auto", "ray", "gl")


class DepthBackend(Protocol):
    """Depth of a scene as each of its cameras sees it."""

    cameras: tuple[Camera, ...]

    def render(self, data: "mujoco.MjData") -> NDArray[np.float32]:
        """Return depth along the optical axis, (cameras, H, W) metres, inf where there is nothing.

        `data` needs current kinematics (`mj_kinematics` or more).
        """

    def segment(self, data: "mujoco.MjData") -> NDArray[np.int32]:
        """Return the geom each pixel shows, (cameras, H, W), -1 where nothing. For evaluation only."""

    def render_rgb(self, data: "mujoco.MjData") -> NDArray[np.uint8]:
        """Return colour images, (cameras, H, W, 3).

        Raises:
            InputError: if there is no GL.
        """

    def close(self) -> None:
        """Free what the backend holds."""


def make_backend(
    name: str, model: "mujoco.MjModel", cameras: tuple[Camera, ...], groups: tuple[int, ...] = VISUAL_GROUPS
) -> DepthBackend:
    """Return a backend.

    Args:
        name: "ray" (ray casting on the CPU, works everywhere), "gl" (needs an OpenGL context), or "auto",
            which is "ray": it gives the same bits on every machine, with a screen or without.
        model: the scene. Later changes to its geoms' sizes are not seen by "ray".
        cameras: all with the same image size.
        groups: the geom groups that are seen.
    """
    if name not in BACKENDS:
        raise unknown_name("depth backend", name, BACKENDS)
    check_cameras(cameras)
    if name == "gl":
        from dexgrasp_env.sensing.gl import GLBackend

        return GLBackend(model, cameras, groups)
    from dexgrasp_env.sensing.raycast import RayBackend

    return RayBackend(model, cameras, groups)


def check_cameras(cameras: tuple[Camera, ...]) -> None:
    """Refuse no camera at all and image sizes that differ, because images are stacked."""
    if not cameras:
        raise InputError("no cameras given: valid are one or more")
    if len({(c.intrinsics.width, c.intrinsics.height) for c in cameras}) > 1:
        raise InputError("cameras have different image sizes: valid is one size for all")
