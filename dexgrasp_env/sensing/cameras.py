"""The four simulated cameras that watch the table, and cameras as part of a model."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from dexgrasp_env.perception.camera import Camera, CameraIntrinsics
from dexgrasp_env.poses import matrix_to_quat

if TYPE_CHECKING:
    import mujoco

_WORKSPACE_CENTRE = (0.52, 0.0, 0.06)  # m, what the default cameras look at
CAMERA_NAMES = ("front_left", "front_right", "side_left", "side_right")
_GL_FROM_OPTICAL = np.diag([1.0, -1.0, -1.0])  # MuJoCo's cameras look along -z with y up


def default_cameras(intrinsics: CameraIntrinsics | None = None) -> tuple[Camera, ...]:
    """Four cameras around the table: two at the front corners, two at the sides behind the objects.

    All of them see the whole region in which objects are put; the two at the back look past the arm.
    """
    mounts = {
        "front_left": (0.98, 0.46, 0.50),
        "front_right": (0.98, -0.46, 0.50),
        "side_left": (0.24, 0.60, 0.46),
        "side_right": (0.24, -0.60, 0.46),
    }
    return tuple(Camera.look_at(name, eye, _WORKSPACE_CENTRE, intrinsics) for name, eye in mounts.items())


def add_cameras(spec: "mujoco.MjSpec", cameras: Iterable[Camera]) -> None:
    """Add the cameras to a model under construction, fixed to the world (= the robot base frame).

    MJCF knows a centred principal point only; the depth backends use the full intrinsics whatever is written
    here.
    """
    for camera in cameras:
        spec.worldbody.add_camera(
            name=camera.name,
            pos=camera.position,
            quat=matrix_to_quat(camera.rotation @ _GL_FROM_OPTICAL),
            fovy=camera.intrinsics.fovy,
            resolution=[camera.intrinsics.width, camera.intrinsics.height],
        )
